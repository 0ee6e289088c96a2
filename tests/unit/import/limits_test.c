/* SPDX-License-Identifier: Apache-2.0
 *
 * What a process may still do after import_limits_set(): tried in a child, for there is no way
 * back.
 */
#include "import/limits.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "unit/import/support.h"

enum { FIRST_FD = 6 };
#define MIB (UINT64_C(1) << 20)

static void set_or_exit(int cpu_seconds) {
    const char *const readable[] = { folder_path(), "/nowhere", NULL };
    struct sp_error err;
    int null = open("/dev/null", O_RDWR);
    dup2(null, 0); /* as launch.c leaves it */
    if (!import_limits_set(cpu_seconds, FIRST_FD, readable, "test", &err))
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
    siginfo_t info = { .si_code = SI_QUEUE };
    return !refused(kill(getppid(), 0)) || !refused(syscall(SYS_tkill, getppid(), 0)) ||
           !refused(syscall(SYS_tgkill, getppid(), getppid(), 0)) ||
           !refused(syscall(SYS_rt_sigqueueinfo, getppid(), SIGTERM, &info)) ||
           !refused(syscall(SYS_pidfd_open, getppid(), 0)) ||
           syscall(SYS_tgkill, getpid(), gettid(), 0) != 0;
}

static int no_other_processes(void) {
    struct rlimit limit;
    set_or_exit(10);
    return !refused(fork()) ||
           !refused(syscall(SYS_prlimit64, getppid(), RLIMIT_CORE, NULL, &limit)) ||
           !refused(setpriority(PRIO_PROCESS, (id_t)getppid(), 19)) ||
           getrlimit(RLIMIT_CORE, &limit) != 0;
}

static void *nothing(void *user) {
    return user;
}

static int threads_of_its_own(void) {
    pthread_t thread;
    set_or_exit(10);
    return pthread_create(&thread, NULL, nothing, NULL) != 0 || pthread_join(thread, NULL) != 0;
}

/* The folder alone, by whatever way; with a kernel that can do it. */
static int no_other_files_read(void) {
    char up[256];
    bool is_confined = import_limits_confine_reading();
    int error = EACCES;
    snprintf(up, sizeof up, "%s/../../etc/passwd", folder_path());
    symlink("/etc/passwd", in_folder("link"));
    set_or_exit(10);
    const char *const others[] = { "/etc/passwd",     "/dev/null", "/proc/self/environ", up,
                                   in_folder("link"), "/etc" };
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        int fd = open(others[i], O_RDONLY | O_CLOEXEC);
        if (is_confined ? fd >= 0 || errno != error : fd < 0)
            return 1;
    }
    return open(in_folder("kept"), O_RDONLY | O_CLOEXEC) < 0;
}

static int no_files_written(void) {
    set_or_exit(10);
    struct open_how how = { .flags = O_RDWR | O_TRUNC };
    if (syscall(SYS_openat2, AT_FDCWD, in_folder("kept"), &how, sizeof how) >= 0 || errno != ENOSYS)
        return 1;
    return !refused(open(in_folder("new"), O_CREAT | O_WRONLY, 0600)) ||
           !refused(open("/dev/null", O_RDWR)) ||
           !refused(open(in_folder("kept"), O_RDONLY | O_TRUNC)) ||
           !refused(utimensat(AT_FDCWD, in_folder("kept"), NULL, 0)) ||
           !refused(unlink(in_folder("kept"))) ||
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

static void *wait_for_ever(void *user) {
    for (;;)
        pause();
    return user;
}

/* What holds for one thread would not hold for the other. */
static int limits_beside_a_thread(void) {
    const char *const readable[] = { folder_path(), NULL };
    struct sp_error err;
    pthread_t thread;
    pthread_create(&thread, NULL, wait_for_ever, NULL);
    return import_limits_set(10, FIRST_FD, readable, "test", &err);
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
        { "processes", no_other_processes },
        { "threads", threads_of_its_own },
        { "reading", no_other_files_read },
        { "files", no_files_written },
        { "memory", no_more_memory_than_the_margin },
        { "limits", limits_are_set },
        { "beside a thread", limits_beside_a_thread },
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
