/* SPDX-License-Identifier: Apache-2.0 */
#include "import/limits.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* The sanitizers reserve terabytes of addresses, and their leak check forks and traces. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SANITIZED 1
#endif
#endif
#ifndef SANITIZED
#define SANITIZED 0
#endif

static bool limit(int resource, rlim_t soft, rlim_t hard) {
    struct rlimit old, new;
    if (getrlimit((__rlimit_resource_t)resource, &old) != 0)
        return false;
    new.rlim_max = hard < old.rlim_max ? hard : old.rlim_max;
    new.rlim_cur = soft < new.rlim_max ? soft : new.rlim_max;
    return setrlimit((__rlimit_resource_t)resource, &new) == 0;
}

#if defined(__x86_64__)
#define OWN_ARCH AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define OWN_ARCH AUDIT_ARCH_AARCH64
#endif

/* Refused with EPERM: a library that asks for them by habit carries on without. */
static const unsigned refused_calls[] = {
    SYS_execve,
    SYS_execveat,
    SYS_socket,
    SYS_socketpair,
    SYS_connect,
    SYS_bind,
    SYS_listen,
    SYS_ptrace,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_process_madvise,
    SYS_kill,
    SYS_tkill,
    SYS_rt_sigqueueinfo,
    SYS_rt_tgsigqueueinfo,
    SYS_pidfd_open,
    SYS_pidfd_getfd,
    SYS_pidfd_send_signal,
    SYS_setpriority,
    SYS_ioprio_set,
    SYS_sched_setaffinity,
    SYS_sched_setattr,
    SYS_sched_setparam,
    SYS_sched_setscheduler,
    SYS_migrate_pages,
    SYS_move_pages,
    SYS_ioctl, /* FIOSETOWN and the like send signals; a terminal takes its owner's input */
    SYS_shmget,
    SYS_shmat,
    SYS_shmctl,
    SYS_msgget,
    SYS_msgsnd,
    SYS_msgrcv,
    SYS_msgctl,
    SYS_semget,
    SYS_semop,
    SYS_semtimedop,
    SYS_semctl,
    SYS_mq_open,
    SYS_mq_unlink,
    SYS_inotify_init1,
    SYS_inotify_add_watch,
    SYS_fanotify_init,
    SYS_fanotify_mark,
    SYS_kcmp,
    SYS_open_by_handle_at,
    SYS_unlinkat,
    SYS_renameat,
    SYS_renameat2,
    SYS_mkdirat,
    SYS_linkat,
    SYS_symlinkat,
    SYS_mknodat,
    SYS_fchmodat,
    SYS_fchownat,
    SYS_fchmod,
    SYS_fchown,
    SYS_truncate,
    SYS_utimensat,
    SYS_mount,
    SYS_umount2,
    SYS_open_tree,
    SYS_move_mount,
    SYS_fsopen,
    SYS_unshare,
    SYS_setns,
    SYS_keyctl,
    SYS_add_key,
    SYS_bpf,
    SYS_chroot,
    SYS_pivot_root,
    SYS_setxattr,
    SYS_lsetxattr,
    SYS_fsetxattr,
    SYS_removexattr,
    SYS_lremovexattr,
    SYS_fremovexattr,
    SYS_userfaultfd,
    SYS_perf_event_open,
    SYS_reboot,
    SYS_init_module,
    SYS_finit_module,
    SYS_io_uring_setup,
#if defined(__x86_64__)
    SYS_fork,
    SYS_vfork,
    SYS_unlink,
    SYS_rename,
    SYS_mkdir,
    SYS_rmdir,
    SYS_link,
    SYS_symlink,
    SYS_mknod,
    SYS_chmod,
    SYS_chown,
    SYS_lchown,
    SYS_creat,
    SYS_utime,
    SYS_utimes,
    SYS_futimesat,
    SYS_inotify_init,
#endif
};
enum { REFUSED = sizeof refused_calls / sizeof refused_calls[0] };

/* Said not to be there: what they ask for lies in memory, and libraries then take those that the
 * filter can judge. */
static const unsigned absent_calls[] = { SYS_openat2, SYS_clone3 };
enum { ABSENT = sizeof absent_calls / sizeof absent_calls[0] };
enum {
    FIRST_NEWER = 451
}; /* and so are calls that came after these lists (Linux 6.5), and x32's */

/* Judged by one argument: has it any of these bits, or is it this number? A call that is judged is
 * refused unless one of its rows lets it through. */
struct judged_call {
    unsigned call, argument;
    unsigned short test; /* BPF_JSET or BPF_JEQ */
    unsigned value;
    bool passes_if;
};
enum { WRITES = O_WRONLY | O_RDWR | O_CREAT | O_TRUNC };

/* A classic BPF program: architecture, then one table after the other. */
static bool filter_calls(void) {
#ifdef OWN_ARCH
    const struct judged_call judged[] = {
        { SYS_openat, 2, BPF_JSET, WRITES, false },
        { SYS_clone, 0, BPF_JSET, CLONE_THREAD, true },
        { SYS_tgkill, 0, BPF_JEQ, (unsigned)getpid(), true }, /* abort() */
        { SYS_prlimit64, 0, BPF_JEQ, 0, true },
        { SYS_prctl, 0, BPF_JEQ, PR_SET_PDEATHSIG, false },
        { SYS_fcntl, 1, BPF_JEQ, F_DUPFD, true }, /* others send signals, lock and lease */
        { SYS_fcntl, 1, BPF_JEQ, F_DUPFD_CLOEXEC, true },
        { SYS_fcntl, 1, BPF_JEQ, F_GETFD, true },
        { SYS_fcntl, 1, BPF_JEQ, F_SETFD, true },
        { SYS_fcntl, 1, BPF_JEQ, F_GETFL, true },
        { SYS_fcntl, 1, BPF_JEQ, F_SETFL, true },
#if defined(__x86_64__)
        { SYS_open, 1, BPF_JSET, WRITES, false },
#endif
    };
    enum { JUDGED = sizeof judged / sizeof judged[0] };
    struct sock_filter code[2 * REFUSED + 2 * ABSENT + 7 * JUDGED + 8];
    unsigned short n = 0;
#define EMIT(...) code[n++] = (struct sock_filter)__VA_ARGS__
    const struct sock_filter refuse = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
                             absent = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS),
                             pass = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
                             load_call = BPF_STMT(BPF_LD | BPF_W | BPF_ABS,
                                                  offsetof(struct seccomp_data, nr));
    EMIT(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, arch)));
    EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, OWN_ARCH, 1, 0));
    EMIT(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS));
    code[n++] = load_call;
    EMIT(BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, FIRST_NEWER, 0, 1));
    code[n++] = absent;
    for (size_t i = 0; i < REFUSED; i++) {
        EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, refused_calls[i], 0, 1));
        code[n++] = refuse;
    }
    for (size_t i = 0; i < ABSENT; i++) {
        EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, absent_calls[i], 0, 1));
        code[n++] = absent;
    }
    for (size_t i = 0; i < JUDGED; i++) { /* the lower half of the argument: all are of 32 bits */
        const struct judged_call *j = &judged[i];
        unsigned place = (unsigned)offsetof(struct seccomp_data, args) + 8 * j->argument;
        EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, j->call, 0, 4));
        EMIT(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, place));
        EMIT(BPF_JUMP(BPF_JMP | j->test | BPF_K, j->value, j->passes_if ? 0 : 1,
                      j->passes_if ? 1 : 0));
        code[n++] = pass;
        code[n++] = load_call;
    }
    for (size_t i = 0; i < JUDGED; i++) {
        EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, judged[i].call, 0, 1));
        code[n++] = refuse;
    }
    code[n++] = pass;
#undef EMIT
    const struct sock_fprog program = { .len = n, .filter = code };
    /* A kernel or container without seccomp still has the limits. */
    return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0 || errno == EINVAL ||
           errno == EACCES || errno == EPERM;
#else
    return true;
#endif
}

/* struct landlock_ruleset_attr of Linux 6.12. An older kernel takes zeros behind its own. */
struct ruleset {
    uint64_t handled_access_fs, handled_access_net, scoped;
};

/* What a kernel's Landlock can refuse; all 0 = it has none, or does not let us. */
static struct ruleset landlock_rules(void) {
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    return (struct ruleset){
        .handled_access_fs = version < 1    ? 0
                             : version == 1 ? 0x1fff /* all up to LANDLOCK_ACCESS_FS_MAKE_SYM */
                             : version == 2 ? 0x3fff /* LANDLOCK_ACCESS_FS_REFER */
                             : version < 5  ? 0x7fff /* LANDLOCK_ACCESS_FS_TRUNCATE */
                                            : 0xffff, /* LANDLOCK_ACCESS_FS_IOCTL_DEV */
        .scoped = version < 6 ? 0 : 3,               /* abstract sockets and signals of others */
    };
}

static bool let_read(int rules, const char *path) {
    struct stat st;
    struct landlock_path_beneath_attr beneath = { .allowed_access = LANDLOCK_ACCESS_FS_READ_FILE,
                                                  .parent_fd = open(path, O_PATH | O_CLOEXEC) };
    bool ok = beneath.parent_fd >= 0 && fstat(beneath.parent_fd, &st) == 0;
    if (ok && S_ISDIR(st.st_mode))
        beneath.allowed_access |= LANDLOCK_ACCESS_FS_READ_DIR;
    ok = ok && syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &beneath, 0) == 0;
    int error = errno;
    if (beneath.parent_fd >= 0)
        close(beneath.parent_fd);
    errno = error;
    return ok;
}

static bool confine_reading(const char *const *readable) {
    const struct ruleset wanted = landlock_rules();
    if (wanted.handled_access_fs == 0)
        return true;
    int rules = (int)syscall(SYS_landlock_create_ruleset, &wanted, sizeof wanted, 0);
    bool ok = rules >= 0 && let_read(rules, readable[0]);
    for (size_t i = 1; ok && readable[i]; i++)
        let_read(rules, readable[i]); /* which may not be there */
    ok = ok && syscall(SYS_landlock_restrict_self, rules, 0) == 0;
    int error = errno;
    if (rules >= 0)
        close(rules);
    errno = error;
    return ok;
}

/* Landlock and the filter hold for the thread that asks and those that it begins. */
static bool has_one_thread(void) {
    struct stat tasks;
    if (stat("/proc/self/task", &tasks) != 0 || tasks.st_nlink == 3)
        return true;
    errno = EBUSY;
    return false;
}

bool import_limits_set(int cpu_seconds, int first_fd, const char *const *readable,
                       const char *shown, struct sp_error *err) {
    bool ok = close_range((unsigned)first_fd, ~0u, 0) == 0 || errno == ENOSYS;
    rlim_t cpu = (rlim_t)(cpu_seconds < 1 ? 1 : cpu_seconds);
    ok = ok && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0;
    ok = ok && prctl(PR_SET_PDEATHSIG, SIGKILL) == 0;
    ok = ok && limit(RLIMIT_CPU, cpu, cpu + 1) && limit(RLIMIT_CORE, 0, 0);
    ok = ok && limit(RLIMIT_NOFILE, 64, 64);
    /* Standard input is the null device; what a library prints must not reach a log file. */
    if (!SANITIZED)
        ok = ok && dup2(0, 2) == 2 && prctl(PR_SET_DUMPABLE, 0) == 0 && limit(RLIMIT_FSIZE, 0, 0) &&
             limit(RLIMIT_AS, IMPORT_MARGIN_BYTES, RLIM_INFINITY) && has_one_thread() &&
             confine_reading(readable) && filter_calls();
    return ok || sp_fail(err, SP_ERR_IO, shown, "cannot limit the reader: %s", strerror(errno));
}

bool import_limits_complete(void) {
    return !SANITIZED;
}

bool import_limits_confine_reading(void) {
    return !SANITIZED && landlock_rules().handled_access_fs != 0;
}

bool import_limits_for_samples(uint64_t bytes, const char *shown, struct sp_error *err) {
    rlim_t room = IMPORT_MARGIN_BYTES + bytes;
    if (SANITIZED || limit(RLIMIT_AS, room, room))
        return true;
    return sp_fail(err, SP_ERR_IO, shown, "cannot limit the reader's memory: %s", strerror(errno));
}
