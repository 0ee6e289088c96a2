/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/sandbox.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "data/import/syscall_filter.h"

/* Sanitizers reserve terabytes of address space, and their leak check forks and traces. */
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

/* Landlock has no library in common distributions; these are its three system calls.
 * struct landlock_ruleset_attr as of Linux 6.12. An older kernel accepts the longer struct if the
 * fields that it does not know are zero. */
struct ruleset {
    uint64_t handled_access_fs, handled_access_net, scoped;
};

enum { BIND_TCP = 1, CONNECT_TCP = 2 }; /* of handled_access_net */

/* The accesses that this kernel's Landlock can refuse; all 0 if it has none or is disabled. */
static struct ruleset landlock_rules(bool has_network) {
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    return (struct ruleset){
        .handled_access_fs = version < 1    ? 0
                             : version == 1 ? 0x1fff /* all up to LANDLOCK_ACCESS_FS_MAKE_SYM */
                             : version == 2 ? 0x3fff /* LANDLOCK_ACCESS_FS_REFER */
                             : version < 5  ? 0x7fff /* LANDLOCK_ACCESS_FS_TRUNCATE */
                                            : 0xffff, /* LANDLOCK_ACCESS_FS_IOCTL_DEV */
        .handled_access_net = version < 4   ? 0
                              : has_network ? BIND_TCP
                                            : BIND_TCP | CONNECT_TCP,
        .scoped = version < 6 ? 0 : 3, /* abstract sockets, signals to others */
    };
}

static bool allow_reading(int rules, const char *path) {
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

static bool confine_reading(const char *const *readable, bool has_network) {
    const struct ruleset wanted = landlock_rules(has_network);
    if (wanted.handled_access_fs == 0)
        return true;
    int rules = (int)syscall(SYS_landlock_create_ruleset, &wanted, sizeof wanted, 0);
    bool ok = rules >= 0 && allow_reading(rules, readable[0]);
    for (size_t i = 1; ok && readable[i]; i++)
        allow_reading(rules, readable[i]); /* may be missing */
    ok = ok && syscall(SYS_landlock_restrict_self, rules, 0) == 0;
    int error = errno;
    if (rules >= 0)
        close(rules);
    errno = error;
    return ok;
}

/* Landlock and seccomp hold for the calling thread and for threads that it starts later. */
static bool has_one_thread(void) {
    struct stat tasks;
    if (stat("/proc/self/task", &tasks) != 0 || tasks.st_nlink == 3)
        return true;
    errno = EBUSY;
    return false;
}

bool import_sandbox_enter(const struct import_sandbox *sandbox, const char *title,
                          struct sp_error *err) {
    const rlim_t cpu = (rlim_t)sandbox->cpu_seconds;
    bool ok = close_range((unsigned)sandbox->first_fd, ~0u, 0) == 0 || errno == ENOSYS;
    ok = ok && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0;
    ok = ok && prctl(PR_SET_PDEATHSIG, SIGKILL) == 0;
    ok = ok && (cpu == 0 || limit(RLIMIT_CPU, cpu, cpu + 1)) && limit(RLIMIT_CORE, 0, 0);
    ok = ok && limit(RLIMIT_NOFILE, 64, 64);
    /* Standard input is the null device. Standard error also becomes it: the output of a library
     * must not reach a log file. */
    if (!SANITIZED)
        ok = ok && dup2(0, 2) == 2 && prctl(PR_SET_DUMPABLE, 0) == 0 && limit(RLIMIT_FSIZE, 0, 0) &&
             limit(RLIMIT_AS, IMPORT_MARGIN_BYTES, RLIM_INFINITY) && has_one_thread() &&
             confine_reading(sandbox->readable, sandbox->has_network) &&
             import_syscall_filter_load(sandbox->has_network);
    return ok || sp_fail(err, SP_ERR_IO, title, "cannot enter the sandbox of the reader: %s",
                         strerror(errno));
}

bool import_sandbox_is_complete(void) {
    return !SANITIZED;
}

bool import_sandbox_confines_reading(void) {
    return !SANITIZED && landlock_rules(false).handled_access_fs != 0;
}

bool import_sandbox_allow_samples(uint64_t bytes, const char *title, struct sp_error *err) {
    rlim_t bytes_max = IMPORT_MARGIN_BYTES + bytes;
    if (SANITIZED || limit(RLIMIT_AS, bytes_max, bytes_max))
        return true;
    return sp_fail(err, SP_ERR_IO, title, "cannot set the memory limit of the reader: %s",
                   strerror(errno));
}
