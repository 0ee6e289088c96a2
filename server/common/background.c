/* SPDX-License-Identifier: Apache-2.0 */
#include "common/background.h"

#include <errno.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "sp/log.h"

void srv_background_thread_enter(const char *thread_name, int niceness) {
    id_t thread = (id_t)gettid();
    errno = 0; /* getpriority() may return -1 without an error */
    int before = getpriority(PRIO_PROCESS, thread);
    if (errno != 0 || setpriority(PRIO_PROCESS, thread, before + niceness) != 0)
        sp_log(SP_LOG_WARN, "cannot lower the priority of %s: %s", thread_name, strerror(errno));
}
