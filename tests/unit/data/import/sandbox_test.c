/* SPDX-License-Identifier: Apache-2.0
 *
 * Tests what a process can still do after import_sandbox_enter(). Each attempt runs in a child
 * process, because a process cannot leave the sandbox.
 */
#include "data/import/sandbox.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/openat2.h>
#include <linux/seccomp.h>
#include <netinet/in.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/msg.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/sem.h>
#include <sys/shm.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "unit/data/import/support.h"

enum { FIRST_FD = 6 };
#define MIB (UINT64_C(1) << 20)

static bool has_network; /* of the sandbox that the attempts enter */

static void enter_sandbox_or_exit(int cpu_seconds) {
    const char *const readable[] = { folder_path(), "/nowhere", NULL };
    struct sp_error err;
    int null = open("/dev/null", O_RDWR);
    dup2(null, 0); /* descriptor 0, as launch.c sets it up */
    const struct import_sandbox sandbox = { .cpu_seconds = cpu_seconds,
                                            .first_fd = FIRST_FD,
                                            .readable = readable,
                                            .has_network = has_network };
    if (!import_sandbox_enter(&sandbox, "test", &err))
        _exit(99);
}

static bool refused(long result) {
    return result < 0 && errno == EPERM;
}

/* Each attempt returns 0 if the sandbox enforces the limit. */
static int descriptors_are_closed(void) {
    int fd = open("/dev/null", O_RDONLY);
    int high = fcntl(fd, F_DUPFD, 40);
    enter_sandbox_or_exit(10);
    return high < 40 || fcntl(high, F_GETFD) >= 0;
}

static int no_other_programs(void) {
    char *argv[] = { (char[]){ "true" }, NULL };
    enter_sandbox_or_exit(10);
    return !refused(execv("/bin/true", argv));
}

static int no_sockets(void) {
    enter_sandbox_or_exit(10);
    return !refused(socket(AF_INET, SOCK_STREAM, 0)) || !refused(socket(AF_UNIX, SOCK_STREAM, 0));
}

/* splat-fetch connects to hosts and asks for names, and accepts no connections. */
static int connections_but_no_servers(void) {
    enum { TCP_RULES = 4 };
    const long version =
        syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    const struct sockaddr_in any = { .sin_family = AF_INET };
    int size = 0, pair[2];
    enter_sandbox_or_exit(10);
    const int tcp = socket(AF_INET, SOCK_STREAM, 0), udp = socket(AF_INET6, SOCK_DGRAM, 0),
              list = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, 0);
    if (tcp < 0 || (udp < 0 && errno != EAFNOSUPPORT) || list < 0 ||
        socketpair(AF_UNIX, SOCK_STREAM, 0, pair) != 0 || ioctl(pair[0], FIONREAD, &size) != 0)
        return 1;
    if (connect(tcp, (const struct sockaddr *)&any, sizeof any) == 0 || errno != ECONNREFUSED)
        return 2; /* port 0 of this machine */
    return !refused(listen(tcp, 1)) || !refused(accept(tcp, NULL, NULL)) ||
           !refused(ioctl(tcp, FIOSETOWN, &size)) || !refused(socket(AF_PACKET, SOCK_RAW, 0)) ||
           !refused(socket(AF_VSOCK, SOCK_STREAM, 0)) ||
           !refused(socket(AF_ALG, SOCK_SEQPACKET, 0)) ||
           (version >= TCP_RULES &&
            (bind(tcp, (const struct sockaddr *)&any, sizeof any) == 0 || errno != EACCES));
}

static int no_signals_to_others(void) {
    enter_sandbox_or_exit(10);
    siginfo_t info = { .si_code = SI_QUEUE };
    return !refused(kill(getppid(), 0)) || !refused(syscall(SYS_tkill, getppid(), 0)) ||
           !refused(syscall(SYS_tgkill, getppid(), getppid(), 0)) ||
           !refused(syscall(SYS_rt_sigqueueinfo, getppid(), SIGTERM, &info)) ||
           !refused(syscall(SYS_pidfd_open, getppid(), 0)) ||
           syscall(SYS_tgkill, getpid(), gettid(), 0) != 0;
}

/* The kernel signals the owner of a descriptor when it becomes ready. The sandbox must not let a
 * process make its parent that owner. */
static int no_signals_by_descriptors(void) {
    enum { FD = 3 }; /* the number of the handover socket */
    int parent = getppid(), on = 1, pair[2];
    struct f_owner_ex owner = { .type = F_OWNER_PID, .pid = parent };
    if (socketpair(AF_UNIX, SOCK_SEQPACKET, 0, pair) != 0 || dup2(pair[0], FD) != FD)
        return 2;
    enter_sandbox_or_exit(10);
    return !refused(fcntl(FD, F_SETOWN, parent)) || !refused(fcntl(FD, F_SETOWN_EX, &owner)) ||
           !refused(fcntl(FD, F_SETSIG, SIGKILL)) || !refused(fcntl(FD, F_SETLEASE, F_RDLCK)) ||
           !refused(fcntl(FD, F_NOTIFY, DN_ACCESS)) || !refused(ioctl(FD, FIOSETOWN, &parent)) ||
           !refused(ioctl(FD, SIOCSPGRP, &parent)) || !refused(ioctl(FD, FIOASYNC, &on)) ||
           fcntl(FD, F_SETFL, fcntl(FD, F_GETFL) | O_NONBLOCK) != 0 ||
           fcntl(FD, F_SETFD, fcntl(FD, F_GETFD) | FD_CLOEXEC) != 0 ||
           fcntl(FD, F_DUPFD_CLOEXEC, 10) < 0;
}

/* Simulates a container whose seccomp filter denies the installation of another filter. */
static bool refuse_filters(void) {
    struct sock_filter code[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_seccomp, 3, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_prctl, 0, 3),
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, args)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, PR_SET_SECCOMP, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EINVAL),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    struct sock_fprog program = { .len = sizeof code / sizeof *code, .filter = code };
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
           prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

/* Landlock alone (Linux 6.12 or later) prevents signals to other processes. */
static int no_signals_without_the_filter(void) {
    enum { WITH_SCOPES = 6 };
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    if (!refuse_filters())
        return 2;
    enter_sandbox_or_exit(10);
    int sent = kill(getppid(), 0);
    bool is_refused = refused(sent);
    return version >= WITH_SCOPES ? !is_refused || kill(getpid(), 0) != 0 : sent != 0;
}

static int it_is_killed_when_its_parent_ends(void) {
    int number = 0;
    enter_sandbox_or_exit(10);
    return !refused(prctl(PR_SET_PDEATHSIG, 0)) || prctl(PR_GET_PDEATHSIG, &number) != 0 ||
           number != SIGKILL;
}

/* System V and POSIX IPC objects are shared by all processes of a user. (An allowed call with the
 * id -1 would fail with EINVAL.) */
static int no_ipc_with_other_processes(void) {
    struct sembuf step = { 0 };
    struct msgbuf message = { .mtype = 1 };
    enter_sandbox_or_exit(10);
    return !refused(shmget(IPC_PRIVATE, 1, 0600 | IPC_CREAT)) ||
           !refused(shmctl(-1, IPC_RMID, NULL)) || !refused((long)shmat(-1, NULL, 0)) ||
           !refused(semget(IPC_PRIVATE, 1, 0600 | IPC_CREAT)) ||
           !refused(semctl(-1, 0, IPC_RMID)) || !refused(semop(-1, &step, 1)) ||
           !refused(syscall(SYS_semop, -1, &step, 1)) ||
           !refused(msgget(IPC_PRIVATE, 0600 | IPC_CREAT)) ||
           !refused(msgctl(-1, IPC_RMID, NULL)) || !refused(msgsnd(-1, &message, 1, 0)) ||
           !refused(msgrcv(-1, &message, 1, 0, 0)) || !refused(syscall(SYS_mq_unlink, "missing")) ||
           !refused(inotify_init1(0));
}

static int no_other_processes(void) {
    struct rlimit limit;
    enter_sandbox_or_exit(10);
    return !refused(fork()) ||
           !refused(syscall(SYS_prlimit64, getppid(), RLIMIT_CORE, NULL, &limit)) ||
           !refused(setpriority(PRIO_PROCESS, (id_t)getppid(), 19)) ||
           getrlimit(RLIMIT_CORE, &limit) != 0;
}

static void *return_argument(void *user) {
    return user;
}

static int threads_can_be_created(void) {
    pthread_t thread;
    enter_sandbox_or_exit(10);
    return pthread_create(&thread, NULL, return_argument, NULL) != 0 ||
           pthread_join(thread, NULL) != 0;
}

/* Only files of the folder can be read, by any path, if the kernel supports that. */
static int no_other_files_read(void) {
    char up[256];
    bool is_confined = import_sandbox_confines_reading();
    int error = EACCES;
    snprintf(up, sizeof up, "%s/../../etc/passwd", folder_path());
    symlink("/etc/passwd", in_folder("link"));
    enter_sandbox_or_exit(10);
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
    enter_sandbox_or_exit(10);
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
    enter_sandbox_or_exit(10);
    void *volatile small = malloc(64 * MIB), *volatile large = malloc(IMPORT_MARGIN_BYTES);
    struct sp_error err;
    if (!small || large)
        return 1;
    if (!import_sandbox_allow_samples(512 * MIB, "test", &err))
        return 2;
    void *samples = mmap(NULL, 512 * MIB, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    large = malloc(IMPORT_MARGIN_BYTES);
    return samples == MAP_FAILED || large;
}

static int limits_are_set(void) {
    struct rlimit core, files, cpu;
    enter_sandbox_or_exit(10);
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

/* The limits of one thread would not apply to the other, so the call must fail. */
static int limits_beside_a_thread(void) {
    const char *const readable[] = { folder_path(), NULL };
    struct sp_error err;
    pthread_t thread;
    pthread_create(&thread, NULL, wait_for_ever, NULL);
    const struct import_sandbox sandbox = { .cpu_seconds = 10,
                                            .first_fd = FIRST_FD,
                                            .readable = readable };
    return import_sandbox_enter(&sandbox, "test", &err);
}

static int abort_still_works(void) {
    enter_sandbox_or_exit(10);
    signal(SIGABRT, SIG_DFL);
    abort();
}

static int cpu_time_ends(void) {
    enter_sandbox_or_exit(1);
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

static void forbidden_operations_fail_in_the_sandbox(void **state) {
    (void)state;
    static const struct {
        const char *name;
        int (*attempt)(void);
    } attempts[] = {
        { "descriptors", descriptors_are_closed },
        { "programs", no_other_programs },
        { "sockets", no_sockets },
        { "signals", no_signals_to_others },
        { "signals of descriptors", no_signals_by_descriptors },
        { "signals without the filter", no_signals_without_the_filter },
        { "parent", it_is_killed_when_its_parent_ends },
        { "IPC", no_ipc_with_other_processes },
        { "processes", no_other_processes },
        { "threads", threads_can_be_created },
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
            fail_msg("%s: the wait status is 0x%x", attempts[i].name, status);
    }
    assert_int_equal(access(in_folder("kept"), F_OK), 0);
    assert_int_equal(access(in_folder("new"), F_OK), -1);
}

/* The sandbox of splat-fetch. */
static void the_network_opens_nothing_else(void **state) {
    (void)state;
    static const struct {
        const char *name;
        int (*attempt)(void);
    } attempts[] = {
        { "descriptors", descriptors_are_closed },
        { "programs", no_other_programs },
        { "connections", connections_but_no_servers },
        { "signals", no_signals_to_others },
        { "parent", it_is_killed_when_its_parent_ends },
        { "IPC", no_ipc_with_other_processes },
        { "processes", no_other_processes },
        { "threads", threads_can_be_created },
        { "reading", no_other_files_read },
        { "files", no_files_written },
        { "limits", limits_are_set },
    };
    has_network = true;
    write_text("kept", "x");
    for (size_t i = 0; i < sizeof attempts / sizeof attempts[0]; i++) {
        int status = status_of(attempts[i].attempt);
        if (status != 0)
            fail_msg("%s: the wait status is 0x%x", attempts[i].name, status);
    }
    has_network = false;
}

static void abort_and_the_cpu_limit_end_the_process(void **state) {
    (void)state;
    int status = status_of(abort_still_works);
    assert_true(WIFSIGNALED(status));
    assert_int_equal(WTERMSIG(status), SIGABRT);
    status = status_of(cpu_time_ends);
    assert_true(WIFSIGNALED(status));
    assert_int_equal(WTERMSIG(status), SIGXCPU);
}

int main(void) {
    if (!import_sandbox_is_complete()) {
        printf("skipped: sanitizer builds have neither the memory limit nor the seccomp filter\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forbidden_operations_fail_in_the_sandbox),
        cmocka_unit_test(the_network_opens_nothing_else),
        cmocka_unit_test(abort_and_the_cpu_limit_end_the_process),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
