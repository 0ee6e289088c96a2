/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/standard.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

void srv_standard_hold(void) {
    int fd;
    do
        fd = open("/dev/null", O_RDONLY);
    while (fd >= 0 && fd <= STDERR_FILENO);
    if (fd >= 0)
        close(fd);
}

bool srv_standard_end(struct sp_error *err) {
    return (fflush(stdout) == 0 && !ferror(stdout)) ||
           sp_fail(err, SP_ERR_IO, "standard output", "cannot write: %s", strerror(errno));
}
