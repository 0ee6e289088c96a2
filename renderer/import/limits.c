/* SPDX-License-Identifier: Apache-2.0 */
#include "import/limits.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <stddef.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
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
    SYS_kill,
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
    SYS_mount,
    SYS_umount2,
    SYS_unshare,
    SYS_setns,
    SYS_keyctl,
    SYS_add_key,
    SYS_bpf,
    SYS_chroot,
    SYS_pivot_root,
    SYS_setxattr,
    SYS_userfaultfd,
    SYS_perf_event_open,
    SYS_reboot,
    SYS_init_module,
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
#endif
};
enum { REFUSED = sizeof refused_calls / sizeof refused_calls[0] };

/* A classic BPF program: architecture, then the table, then opening a file for writing. */
static bool filter_calls(void) {
#ifdef OWN_ARCH
    struct sock_filter code[2 * REFUSED + 24];
    unsigned short n = 0;
#define EMIT(...) code[n++] = (struct sock_filter)__VA_ARGS__
    const struct sock_filter refuse = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM);
    EMIT(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, arch)));
    EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, OWN_ARCH, 1, 0));
    EMIT(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS));
    EMIT(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)));
#if defined(__x86_64__)
    EMIT(BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, 0x40000000, 0, 1)); /* the x32 calls */
    code[n++] = refuse;
#endif
    for (size_t i = 0; i < REFUSED; i++) {
        EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, refused_calls[i], 0, 1));
        code[n++] = refuse;
    }
    const unsigned writes = O_WRONLY | O_RDWR | O_CREAT | O_TRUNC;
    EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_openat, 0, 3));
    EMIT(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, args[2])));
    EMIT(BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, writes, 0, 1));
    code[n++] = refuse;
#if defined(__x86_64__)
    EMIT(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)));
    EMIT(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_open, 0, 3));
    EMIT(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, args[1])));
    EMIT(BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, writes, 0, 1));
    code[n++] = refuse;
#endif
    EMIT(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
#undef EMIT
    const struct sock_fprog program = { .len = n, .filter = code };
    /* A kernel or container without seccomp still has the limits. */
    return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0 || errno == EINVAL ||
           errno == EACCES || errno == EPERM;
#else
    return true;
#endif
}

bool import_limits_set(int cpu_seconds, int first_fd, const char *shown, struct sp_error *err) {
    bool ok = close_range((unsigned)first_fd, ~0u, 0) == 0 || errno == ENOSYS;
    rlim_t cpu = (rlim_t)(cpu_seconds < 1 ? 1 : cpu_seconds);
    ok = ok && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0;
    ok = ok && prctl(PR_SET_PDEATHSIG, SIGKILL) == 0;
    ok = ok && limit(RLIMIT_CPU, cpu, cpu + 1) && limit(RLIMIT_CORE, 0, 0);
    ok = ok && limit(RLIMIT_NOFILE, 64, 64);
    /* Standard input is the null device; what a library prints must not reach a log file. */
    if (!SANITIZED)
        ok = ok && dup2(0, 2) == 2 && prctl(PR_SET_DUMPABLE, 0) == 0 && limit(RLIMIT_FSIZE, 0, 0) &&
             limit(RLIMIT_AS, IMPORT_MARGIN_BYTES, RLIM_INFINITY) && filter_calls();
    return ok || sp_fail(err, SP_ERR_IO, shown, "cannot limit the reader: %s", strerror(errno));
}

bool import_limits_complete(void) {
    return !SANITIZED;
}

bool import_limits_for_samples(uint64_t bytes, const char *shown, struct sp_error *err) {
    rlim_t room = IMPORT_MARGIN_BYTES + bytes;
    if (SANITIZED || limit(RLIMIT_AS, room, room))
        return true;
    return sp_fail(err, SP_ERR_IO, shown, "cannot limit the reader's memory: %s", strerror(errno));
}
