/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/syscall_filter.h"

#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <seccomp.h>
#include <stddef.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

static const int refused_calls[] = {
    /* Other programs and processes. */
    SCMP_SYS(execve), SCMP_SYS(execveat), SCMP_SYS(fork), SCMP_SYS(vfork), SCMP_SYS(ptrace),
    SCMP_SYS(process_vm_readv), SCMP_SYS(process_vm_writev), SCMP_SYS(process_madvise),
    SCMP_SYS(kill), SCMP_SYS(tkill), SCMP_SYS(rt_sigqueueinfo), SCMP_SYS(rt_tgsigqueueinfo),
    SCMP_SYS(pidfd_open), SCMP_SYS(pidfd_getfd), SCMP_SYS(pidfd_send_signal), SCMP_SYS(kcmp),
    SCMP_SYS(setpriority), SCMP_SYS(ioprio_set), SCMP_SYS(sched_setaffinity),
    SCMP_SYS(sched_setattr), SCMP_SYS(sched_setparam), SCMP_SYS(sched_setscheduler),
    SCMP_SYS(migrate_pages), SCMP_SYS(move_pages),
    /* Servers and messages. */
    SCMP_SYS(listen), SCMP_SYS(accept), SCMP_SYS(accept4), SCMP_SYS(shmget), SCMP_SYS(shmat),
    SCMP_SYS(shmctl), SCMP_SYS(msgget), SCMP_SYS(msgsnd), SCMP_SYS(msgrcv), SCMP_SYS(msgctl),
    SCMP_SYS(semget), SCMP_SYS(semop), SCMP_SYS(semtimedop), SCMP_SYS(semctl), SCMP_SYS(mq_open),
    SCMP_SYS(mq_unlink),
    /* The file tree. */
    SCMP_SYS(creat), SCMP_SYS(open_by_handle_at), SCMP_SYS(unlink), SCMP_SYS(unlinkat),
    SCMP_SYS(rename), SCMP_SYS(renameat), SCMP_SYS(renameat2), SCMP_SYS(mkdir), SCMP_SYS(mkdirat),
    SCMP_SYS(rmdir), SCMP_SYS(link), SCMP_SYS(linkat), SCMP_SYS(symlink), SCMP_SYS(symlinkat),
    SCMP_SYS(mknod), SCMP_SYS(mknodat), SCMP_SYS(chmod), SCMP_SYS(fchmod), SCMP_SYS(fchmodat),
    SCMP_SYS(chown), SCMP_SYS(lchown), SCMP_SYS(fchown), SCMP_SYS(fchownat), SCMP_SYS(truncate),
    SCMP_SYS(utime), SCMP_SYS(utimes), SCMP_SYS(futimesat), SCMP_SYS(utimensat), SCMP_SYS(setxattr),
    SCMP_SYS(lsetxattr), SCMP_SYS(fsetxattr), SCMP_SYS(removexattr), SCMP_SYS(lremovexattr),
    SCMP_SYS(fremovexattr), SCMP_SYS(inotify_init), SCMP_SYS(inotify_init1),
    SCMP_SYS(inotify_add_watch), SCMP_SYS(fanotify_init), SCMP_SYS(fanotify_mark), SCMP_SYS(mount),
    SCMP_SYS(umount2), SCMP_SYS(open_tree), SCMP_SYS(move_mount), SCMP_SYS(fsopen),
    SCMP_SYS(chroot), SCMP_SYS(pivot_root),
    /* The system. */
    SCMP_SYS(unshare), SCMP_SYS(setns), SCMP_SYS(keyctl), SCMP_SYS(add_key), SCMP_SYS(bpf),
    SCMP_SYS(userfaultfd), SCMP_SYS(perf_event_open), SCMP_SYS(reboot), SCMP_SYS(init_module),
    SCMP_SYS(finit_module), SCMP_SYS(io_uring_setup)
};

static const int network_calls[] = { SCMP_SYS(socket), SCMP_SYS(socketpair), SCMP_SYS(connect),
                                     SCMP_SYS(bind) };

/* Their arguments lie in memory, which a filter cannot read. */
static const int absent_calls[] = { SCMP_SYS(openat2), SCMP_SYS(clone3) };

/* Numbers of system calls that came after the list above (Linux 6.5). */
enum { NEWER_FIRST = 451, NEWER_LAST = 1023 };

static const unsigned write_flags[] = { O_WRONLY, O_RDWR, O_CREAT, O_TRUNC };

#define COUNT(array) (sizeof(array) / sizeof(array)[0])
#define REFUSE SCMP_ACT_ERRNO(EPERM)
#define ABSENT SCMP_ACT_ERRNO(ENOSYS)

/* A call that this architecture lacks has a negative number. */
static int add(scmp_filter_ctx filter, uint32_t action, int call) {
    return call < 0 ? 0 : seccomp_rule_add(filter, action, call, 0);
}

static int refuse_if(scmp_filter_ctx filter, int call, struct scmp_arg_cmp test) {
    return call < 0 ? 0 : seccomp_rule_add_array(filter, REFUSE, call, 1, &test);
}

/* fcntl() may duplicate descriptors and read or set their flags: commands 0 to 4 and
 * F_DUPFD_CLOEXEC (1030). Other commands send signals, lock or lease. One rule can compare an
 * argument once, so the refused commands are written as ranges. */
static int add_fcntl_rules(scmp_filter_ctx filter) {
    const int call = SCMP_SYS(fcntl);
    int rc = refuse_if(filter, call, SCMP_A1(SCMP_CMP_GT, F_DUPFD_CLOEXEC));
    for (unsigned command = F_SETFL + 1; rc == 0 && command < 8; command++)
        rc = refuse_if(filter, call, SCMP_A1(SCMP_CMP_EQ, command));
    for (uint64_t start = 8; rc == 0 && start < 1024; start *= 2) /* [start, 2 · start) */
        rc = refuse_if(filter, call, SCMP_A1(SCMP_CMP_MASKED_EQ, ~(start - 1), start));
    for (unsigned command = 1024; rc == 0 && command < F_DUPFD_CLOEXEC; command++)
        rc = refuse_if(filter, call, SCMP_A1(SCMP_CMP_EQ, command));
    return rc;
}

/* Calls that depend on an argument. The kernel reads the lower 32 bits of it. */
static int add_argument_rules(scmp_filter_ctx filter) {
    int rc = 0;
    for (size_t i = 0; rc == 0 && i < COUNT(write_flags); i++) {
        unsigned flag = write_flags[i];
        rc = refuse_if(filter, SCMP_SYS(open), SCMP_A1(SCMP_CMP_MASKED_EQ, flag, flag));
        if (rc == 0)
            rc = refuse_if(filter, SCMP_SYS(openat), SCMP_A2(SCMP_CMP_MASKED_EQ, flag, flag));
    }
    if (rc == 0) /* a new process */
        rc = refuse_if(filter, SCMP_SYS(clone), SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD, 0));
    if (rc == 0) /* a signal to another process; abort() sends one to itself */
        rc = refuse_if(filter, SCMP_SYS(tgkill), SCMP_A0(SCMP_CMP_NE, (scmp_datum_t)getpid()));
    if (rc == 0) /* the limits of another process */
        rc = refuse_if(filter, SCMP_SYS(prlimit64), SCMP_A0(SCMP_CMP_NE, 0));
    if (rc == 0) /* outliving the parent */
        rc = refuse_if(filter, SCMP_SYS(prctl),
                       SCMP_A0(SCMP_CMP_MASKED_EQ, UINT32_MAX, PR_SET_PDEATHSIG));
    return rc == 0 ? add_fcntl_rules(filter) : rc;
}

/* Without the network no sockets; otherwise only the families that name resolution and TLS need. */
static int add_network_rules(scmp_filter_ctx filter, bool has_network) {
    int rc = 0;
    for (size_t i = 0; rc == 0 && !has_network && i < COUNT(network_calls); i++)
        rc = add(filter, REFUSE, network_calls[i]);
    for (unsigned family = 0; rc == 0 && has_network && family < AF_NETLINK; family++)
        if (family != AF_UNIX && family != AF_INET && family != AF_INET6)
            rc = refuse_if(filter, SCMP_SYS(socket), SCMP_A0(SCMP_CMP_EQ, family));
    if (rc == 0 && has_network)
        rc = refuse_if(filter, SCMP_SYS(socket), SCMP_A0(SCMP_CMP_GT, AF_NETLINK));
    /* FIOSETOWN sends signals, and the calls of a terminal take the input of its owner. */
    return rc != 0       ? rc
           : has_network ? refuse_if(filter, SCMP_SYS(ioctl), SCMP_A1(SCMP_CMP_NE, FIONREAD))
                         : add(filter, REFUSE, SCMP_SYS(ioctl));
}

static int add_rules(scmp_filter_ctx filter, bool has_network) {
    int rc = add_network_rules(filter, has_network);
    for (size_t i = 0; rc == 0 && i < COUNT(refused_calls); i++)
        rc = add(filter, REFUSE, refused_calls[i]);
    for (size_t i = 0; rc == 0 && i < COUNT(absent_calls); i++)
        rc = add(filter, ABSENT, absent_calls[i]);
    for (int call = NEWER_FIRST; rc == 0 && call <= NEWER_LAST; call++)
        rc = add(filter, ABSENT, call);
    return rc == 0 ? add_argument_rules(filter) : rc;
}

bool import_syscall_filter_load(bool has_network) {
    enum { BINARY_TREE = 2 };
    scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ALLOW);
    if (!filter) {
        errno = ENOMEM;
        return false;
    }
    /* Kernels before 4.14 kill only the thread, which is the default. */
    seccomp_attr_set(filter, SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS);
    int rc = seccomp_attr_set(filter, SCMP_FLTATR_CTL_OPTIMIZE, BINARY_TREE);
    if (rc == 0) /* seccomp_load() returns the kernel's errno */
        rc = seccomp_attr_set(filter, SCMP_FLTATR_API_SYSRAWRC, 1);
    if (rc == 0)
        rc = add_rules(filter, has_network);
    bool is_built = rc == 0;
    if (is_built)
        rc = seccomp_load(filter);
    seccomp_release(filter);
    errno = -rc;
    bool is_unavailable = is_built && (rc == -EINVAL || rc == -EACCES || rc == -EPERM);
    return rc == 0 || is_unavailable;
}
