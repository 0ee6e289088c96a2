/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/service.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <systemd/sd-daemon.h>
#include <time.h>
#include <unistd.h>

void srv_standard_occupy(void) {
    int fd;
    do
        fd = open("/dev/null", O_RDONLY);
    while (fd >= 0 && fd <= STDERR_FILENO);
    if (fd >= 0)
        close(fd);
}

bool srv_standard_finish(struct sp_error *err) {
    return (fflush(stdout) == 0 && !ferror(stdout)) ||
           sp_fail(err, SP_ERR_IO, "standard output", "cannot write: %s", strerror(errno));
}

static void *watch_input(void *unused) {
    (void)unused;
    char dropped[256];
    ssize_t got;
    do
        got = read(STDIN_FILENO, dropped, sizeof dropped);
    while (got > 0 || (got < 0 && errno == EINTR));
    kill(getpid(), SIGTERM);
    return NULL;
}

bool srv_service_watch_input(bool ends, struct sp_error *err) {
    pthread_t thread;
    if (!ends)
        return true;
    if (pthread_create(&thread, NULL, watch_input, NULL) != 0)
        return sp_fail(err, SP_ERR_MEMORY, "--end-with-input", "cannot start a thread");
    pthread_detach(thread); /* it may wait in read() for ever */
    return true;
}

void srv_service_ready(const char *listen) {
    sd_notifyf(0, "READY=1\nSTATUS=listening on %s", listen);
}

void srv_service_reloading(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%" PRIu64 "\nSTATUS=reloading",
               (uint64_t)now.tv_sec * 1000000 + (uint64_t)now.tv_nsec / 1000);
}

void srv_service_stopping(void) {
    sd_notify(0, "STOPPING=1\nSTATUS=finishing requests in progress");
}

double srv_service_watchdog_ms(void) {
    uint64_t us = 0;
    return sd_watchdog_enabled(0, &us) > 0 ? (double)us / 1000 : 0;
}

void srv_service_alive(void) {
    sd_notify(0, "WATCHDOG=1");
}
