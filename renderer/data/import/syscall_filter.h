/* SPDX-License-Identifier: Apache-2.0
 *
 * The seccomp filter of the import process and of splat-fetch, built with libseccomp.
 */
#ifndef SP_IMPORT_SYSCALL_FILTER_H
#define SP_IMPORT_SYSCALL_FILTER_H

#include <stdbool.h>

/* Refuses system calls that reach other processes, the network, or the file tree for writing:
 *   EPERM    listed calls; libraries that try them out of habit continue
 *   ENOSYS   calls whose arguments the filter cannot see, and calls newer than the list; libraries
 *            then fall back to older calls
 *   killed   calls of another architecture
 * With `has_network` the process may create and connect sockets: IPv4, IPv6, local, and netlink,
 * which lists the addresses of this machine. It may not listen. The filter holds for the calling
 * thread and for threads that it starts later, so call it while the process has one thread and
 * after PR_SET_NO_NEW_PRIVS. Returns true as well where the kernel or a container allows no filter:
 * the other limits remain. False with errno set on failure. */
bool import_syscall_filter_load(bool has_network);

#endif
