/* SPDX-License-Identifier: Apache-2.0 */
#include "common/background.h"

#include <errno.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "sp/log.h"

enum { BACKGROUND_NICE = 10 };

void srv_background_thread_enter(const char *thread_name) {
    id_t thread = (id_t)gettid();
    errno = 0; /* getpriority() may return -1 without an error */
    int niceness = getpriority(PRIO_PROCESS, thread);
    if (errno != 0 || setpriority(PRIO_PROCESS, thread, niceness + BACKGROUND_NICE) != 0)
        sp_log(SP_LOG_WARN, "cannot lower the priority of %s: %s", thread_name, strerror(errno));
}
