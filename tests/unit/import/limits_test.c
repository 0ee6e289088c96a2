/* SPDX-License-Identifier: Apache-2.0
 *
 * What a process may still do after import_limits_set(): tried in a child, for there is no way
 * back.
 */
#include "import/limits.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "unit/import/support.h"

enum { FIRST_FD = 6 };
#define MIB (UINT64_C(1) << 20)

static void set_or_exit(int cpu_seconds) {
    struct sp_error err;
    int null = open("/dev/null", O_RDWR);
    dup2(null, 0); /* as launch.c leaves it */
    if (!import_limits_set(cpu_seconds, FIRST_FD, "test", &err))
        _exit(99);
}

static bool refused(long result) {
    return result < 0 && errno == EPERM;
}

/* Each returns 0 when the limit holds. */
static int descriptors_are_closed(void) {
    int fd = open("/dev/null", O_RDONLY);
    int high = fcntl(fd, F_DUPFD, 40);
    set_or_exit(10);
    return high < 40 || fcntl(high, F_GETFD) >= 0;
}

static int no_other_programs(void) {
    char *argv[] = { (char[]){ "true" }, NULL };
    set_or_exit(10);
    return !refused(execv("/bin/true", argv));
}

static int no_sockets(void) {
    set_or_exit(10);
    return !refused(socket(AF_INET, SOCK_STREAM, 0)) || !refused(socket(AF_UNIX, SOCK_STREAM, 0));
}

static int no_signals_to_others(void) {
    set_or_exit(10);
    return !refused(kill(getppid(), 0));
}

static int no_files_written(void) {
    set_or_exit(10);
    if (open("/dev/null", O_RDONLY | O_CLOEXEC) < 0) /* reading is needed for libraries */
        return 1;
    return !refused(open(in_folder("new"), O_CREAT | O_WRONLY, 0600)) ||
           !refused(open("/dev/null", O_RDWR)) || !refused(unlink(in_folder("kept"))) ||
           !refused(rename(in_folder("kept"), in_folder("moved")));
}

static int no_more_memory_than_the_margin(void) {
    set_or_exit(10);
    void *volatile small = malloc(64 * MIB), *volatile large = malloc(IMPORT_MARGIN_BYTES);
    struct sp_error err;
    if (!small || large)
        return 1;
    if (!import_limits_for_samples(512 * MIB, "test", &err))
        return 2;
    void *samples = mmap(NULL, 512 * MIB, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    large = malloc(IMPORT_MARGIN_BYTES);
    return samples == MAP_FAILED || large;
}

static int limits_are_set(void) {
    struct rlimit core, files, cpu;
    set_or_exit(10);
    return getrlimit(RLIMIT_CORE, &core) != 0 || core.rlim_max != 0 ||
           getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_max != 64 ||
           getrlimit(RLIMIT_CPU, &cpu) != 0 || cpu.rlim_cur != 10 ||
           prctl(PR_GET_NO_NEW_PRIVS, 0, 0, 0, 0) != 1;
}

static int abort_still_works(void) {
    set_or_exit(10);
    signal(SIGABRT, SIG_DFL);
    abort();
}

static int cpu_time_ends(void) {
    set_or_exit(1);
    for (volatile unsigned long i = 0; i + 1 != 0; i++)
        ;
    return 1;
}

static int status_of(int (*attempt)(void)) {
    pid_t child = fork();
    if (child == 0)
        _exit(attempt());
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    return status;
}

static void what_is_limited_fails(void **state) {
    (void)state;
    static const struct {
        const char *name;
        int (*attempt)(void);
    } attempts[] = {
        { "descriptors", descriptors_are_closed },
        { "programs", no_other_programs },
        { "sockets", no_sockets },
        { "signals", no_signals_to_others },
        { "files", no_files_written },
        { "memory", no_more_memory_than_the_margin },
        { "limits", limits_are_set },
    };
    write_text("kept", "x");
    for (size_t i = 0; i < sizeof attempts / sizeof attempts[0]; i++) {
        int status = status_of(attempts[i].attempt);
        if (status != 0)
            fail_msg("%s: status %x", attempts[i].name, status);
    }
    assert_int_equal(access(in_folder("kept"), F_OK), 0);
    assert_int_equal(access(in_folder("new"), F_OK), -1);
}

static void death_is_seen(void **state) {
    (void)state;
    int status = status_of(abort_still_works);
    assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT);
    status = status_of(cpu_time_ends);
    assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU);
}

int main(void) {
    if (!import_limits_complete()) {
        printf("skipped: a sanitizer's build has neither the memory limit nor the filter\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_limited_fails),
        cmocka_unit_test(death_is_seen),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
