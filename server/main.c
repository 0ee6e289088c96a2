/* SPDX-License-Identifier: Apache-2.0
 *
 * splatd: settings → daemon → signal (SIGHUP: reload) → drain.
 */
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <unistd.h>

#include "config.h"
#include "daemon.h"
#include "probe.h"

enum { EXIT_OK = 0, EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_NO_GPU = 3 };

static int complain(const struct sp_error *err) {
    fprintf(stderr, "splatd: %s%s%s\n", err->place, err->place[0] ? ": " : "", err->text);
    return err->code == SP_ERR_INVALID ? EXIT_USAGE : EXIT_FAILED;
}

static void on_second_signal(int number) {
    (void)number;
    _exit(EXIT_FAILED);
}

/* These are taken by main() alone; all threads inherit the mask. */
static void block_signals(sigset_t *set) {
    sigemptyset(set);
    sigaddset(set, SIGTERM);
    sigaddset(set, SIGINT);
    sigaddset(set, SIGHUP);
    pthread_sigmask(SIG_BLOCK, set, NULL);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* a file over its limit is an error of the write */
}

static void let_second_signal_end(const sigset_t *set) {
    struct sigaction action = { .sa_handler = on_second_signal };
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    pthread_sigmask(SIG_UNBLOCK, set, NULL);
}

static int run(const struct srv_config *config) {
    static struct srv_log log; /* outlives every thread */
    struct sp_error err = { .code = SP_OK };
    sigset_t signals;
    char url[256];
    int number = 0;
    srv_log_init(&log, config->log_level);
    block_signals(&signals);
    struct srv_daemon *daemon = srv_daemon_start(config, &log, &err);
    if (!daemon)
        return complain(&err);
    srv_daemon_url(daemon, url, sizeof url);
    printf("splatd: listening on %s\n", url);
    fflush(stdout);
    while (sigwait(&signals, &number) == 0 && number == SIGHUP)
        srv_daemon_reload(daemon);
    sigdelset(&signals, SIGHUP);
    sp_log(SP_LOG_INFO, "signal %d: shutting down; once more ends at once", number);
    let_second_signal_end(&signals);
    srv_daemon_stop(&daemon);
    sp_log(SP_LOG_INFO, "stopped");
    return EXIT_OK;
}

int main(int argc, char **argv) {
    struct srv_config config;
    struct sp_error err = { .code = SP_OK };
    int status = EXIT_OK;
    if (!srv_config_init(&config, &err))
        return complain(&err);
    if (!srv_config_parse(&config, argc, argv, &err))
        status = complain(&err);
    else if (config.help)
        srv_config_print_help(stdout);
    else if (config.version)
        printf("splatd %s\n", SPLATD_VERSION);
    else if (config.probe)
        status = srv_probe(stdout) ? EXIT_OK : EXIT_NO_GPU;
    else if (config.print_config)
        srv_config_print(&config, stdout);
    else
        status = run(&config);
    srv_config_finish(&config);
    return status;
}
