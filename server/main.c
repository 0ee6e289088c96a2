/* SPDX-License-Identifier: Apache-2.0
 *
 * splatd: reads the settings, starts the daemon, waits for a signal (SIGHUP reloads), drains.
 */
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <unistd.h>

#include "common/clock.h"
#include "config/config.h"
#include "ops/probe.h"
#include "ops/service.h"
#include "server/daemon.h"

enum { EXIT_OK = 0, EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_NO_GPU = 3 };

static int complain(const struct sp_error *err) {
    fprintf(stderr, "splatd: %s%s%s\n", err->place, err->place[0] ? ": " : "", err->text);
    return err->code == SP_ERR_INVALID ? EXIT_USAGE : EXIT_FAILED;
}

static void on_second_signal(int number) {
    (void)number;
    _exit(EXIT_FAILED);
}

/* Only main() receives these signals; all threads inherit the mask. */
static void block_signals(sigset_t *set) {
    sigemptyset(set);
    sigaddset(set, SIGTERM);
    sigaddset(set, SIGINT);
    sigaddset(set, SIGHUP);
    pthread_sigmask(SIG_BLOCK, set, NULL);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* writing beyond the file size limit is then an error */
}

static void exit_on_second_signal(const sigset_t *set) {
    struct sigaction action = { .sa_handler = on_second_signal };
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    pthread_sigmask(SIG_UNBLOCK, set, NULL);
}

static void reload(struct srv_daemon *daemon, const struct srv_config *config, int argc,
                   char **argv) {
    struct srv_config fresh;
    struct sp_error err = { .code = SP_OK };
    srv_service_reloading();
    if (!srv_config_init(&fresh, &err)) {
        sp_log(SP_LOG_ERROR, "reload failed; keeping the old configuration: %s", err.text);
    } else {
        if (srv_config_parse(&fresh, argc, argv, &err))
            srv_daemon_reload(daemon, &fresh);
        else
            sp_log(SP_LOG_ERROR, "reload failed; keeping the old configuration: %s: %s", err.place,
                   err.text);
        srv_config_finish(&fresh);
    }
    srv_service_ready(config->listen);
}

/* Serves until a signal ends the daemon, and returns its number. */
static int serve(struct srv_daemon *daemon, const struct srv_config *config,
                 const sigset_t *signals, int argc, char **argv) {
    double watchdog_ms = srv_service_watchdog_ms();
    long step_ms = watchdog_ms > 0 ? (long)(watchdog_ms / 4) : 3600000;
    const struct timespec step = { step_ms / 1000, step_ms % 1000 * 1000000 };
    for (;;) {
        int number = sigtimedwait(signals, NULL, &step);
        if (number == SIGHUP)
            reload(daemon, config, argc, argv);
        else if (number > 0)
            return number;
        double silent_ms = srv_clock_ms() - srv_daemon_last_tick_ms(daemon);
        if (watchdog_ms > 0 && silent_ms < watchdog_ms / 2)
            srv_service_alive();
        else if (watchdog_ms > 0)
            sp_log(SP_LOG_ERROR, "the stream or timer thread was blocked for %.0f ms", silent_ms);
    }
}

/* Prints one line per address. If it fails, the daemon stops: programs wait for these lines. */
static bool print_addresses(const struct srv_daemon *daemon, struct sp_error *err) {
    char url[SRV_DAEMON_URL_BYTES];
    for (unsigned i = 0; srv_daemon_url(daemon, i, url, sizeof url); i++)
        printf("splatd: listening on %s\n", url);
    return srv_standard_finish(err);
}

static int run(const struct srv_config *config, int argc, char **argv) {
    static struct srv_log log; /* static: the log thread may outlive main() */
    struct sp_error err = { .code = SP_OK };
    enum sp_log_level level = SP_LOG_INFO;
    sigset_t signals;
    srv_log_level_from(config->log_level, &level);
    block_signals(&signals);
    if (!srv_log_start(&log, level, srv_log_format_from(config->log_format), &err))
        return complain(&err);
    bool watches = srv_service_watch_input(config->end_with_input, &err);
    struct srv_daemon *daemon = watches ? srv_daemon_start(config, &log, &err) : NULL;
    if (!daemon || !print_addresses(daemon, &err)) {
        srv_daemon_stop(&daemon);
        srv_log_end(&log);
        return complain(&err);
    }
    srv_service_ready(config->listen);
    int number = serve(daemon, config, &signals, argc, argv);
    srv_service_stopping();
    sigdelset(&signals, SIGHUP);
    sp_log(SP_LOG_INFO, "received signal %d: shutting down; a second signal exits at once", number);
    exit_on_second_signal(&signals);
    srv_daemon_stop(&daemon);
    srv_log_tick(&log, INFINITY);
    sp_log(SP_LOG_INFO, "stopped");
    srv_log_end(&log);
    return EXIT_OK;
}

/* Handles the options that print something and exit. */
static int print(const struct srv_config *config, struct sp_error *err) {
    int status = EXIT_OK;
    if (config->help)
        srv_config_print_help(stdout);
    else if (config->version)
        printf("splatd %s\n", SPLATD_VERSION);
    else if (config->probe)
        status = srv_probe(stdout) ? EXIT_OK : EXIT_NO_GPU;
    else
        srv_config_print(config, stdout);
    return srv_standard_finish(err) ? status : complain(err);
}

int main(int argc, char **argv) {
    struct srv_config config;
    struct sp_error err = { .code = SP_OK };
    int status;
    srv_standard_occupy();
    if (!srv_config_init(&config, &err) || !srv_config_parse(&config, argc, argv, &err))
        status = complain(&err);
    else if (config.help || config.version || config.probe || config.print_config)
        status = print(&config, &err);
    else
        status = run(&config, argc, argv);
    srv_config_finish(&config);
    return status;
}
