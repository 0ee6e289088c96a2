/* SPDX-License-Identifier: Apache-2.0
 *
 * A library for LD_PRELOAD: a thread that waits for events keeps waiting while another process
 * holds a lock on the file SPLATD_HOLD. This makes event-driven threads hang.
 */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/file.h>
#include <unistd.h>

__attribute__((visibility("default"))) int epoll_wait(int epoll, struct epoll_event *events,
                                                      int count, int timeout) {
    int (*real)(int, struct epoll_event *, int, int) =
        (int (*)(int, struct epoll_event *, int, int))dlsym(RTLD_NEXT, "epoll_wait");
    int file = open(getenv("SPLATD_HOLD"), O_RDONLY | O_CLOEXEC);
    flock(file, LOCK_SH);
    close(file);
    return real(epoll, events, count, timeout);
}
