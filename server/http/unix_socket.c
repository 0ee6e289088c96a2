/* SPDX-License-Identifier: Apache-2.0 */
#include "http/unix_socket.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { LOCK_TRIES = 500 }; /* of 10 ms */

/* Locks the folder of the path against other daemons that start; −1: *err is set. */
static int lock_folder(const char *path, struct sp_error *err) {
    const char *slash = strrchr(path, '/');
    char folder[SRV_UNIX_PATH_BYTES] = ".";
    if (slash)
        snprintf(folder, sizeof folder, "%.*s", (int)(slash - path) + 1, path);
    const struct timespec pause = { .tv_nsec = 10000000 };
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC), tries = 0;
    while (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK &&
           ++tries < LOCK_TRIES)
        nanosleep(&pause, NULL);
    if (fd >= 0 && tries < LOCK_TRIES)
        return fd;
    sp_fail(err, SP_ERR_IO, path, "cannot %s its folder: %s", fd < 0 ? "open" : "lock",
            fd < 0 ? strerror(errno) : "another program holds the lock");
    if (fd >= 0)
        close(fd);
    return -1;
}

static void write_address(const char *path, struct sockaddr_un *address) {
    memset(address, 0, sizeof *address);
    address->sun_family = AF_UNIX;
    snprintf(address->sun_path, sizeof address->sun_path, "%s", path);
}

/* Removes the socket of a program that has ended. With the folder locked. */
static bool remove_stale(const char *path, struct sp_error *err) {
    struct sockaddr_un address;
    struct stat st;
    if (lstat(path, &st) != 0)
        return errno == ENOENT ||
               sp_fail(err, SP_ERR_IO, path, "cannot listen: %s", strerror(errno));
    if (!S_ISSOCK(st.st_mode))
        return sp_fail(err, SP_ERR_IO, path,
                       "is there and is no socket; choose another path with --listen");
    int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    write_address(path, &address);
    const bool is_alive = probe < 0 ||
                          connect(probe, (struct sockaddr *)&address, sizeof address) == 0 ||
                          errno != ECONNREFUSED;
    if (probe >= 0)
        close(probe);
    if (is_alive)
        return sp_fail(err, SP_ERR_IO, path,
                       "a program listens on this socket; another splatd may run there; choose "
                       "another path with --listen");
    return unlink(path) == 0 || errno == ENOENT ||
           sp_fail(err, SP_ERR_IO, path, "cannot remove the socket of a program that has ended: %s",
                   strerror(errno));
}

/* fchmod() before bind() decides the mode of the file, without a moment in which others may
 * connect. */
static bool listen_on(struct srv_unix_socket *s, struct sp_error *err) {
    struct sockaddr_un address;
    struct stat st;
    write_address(s->path, &address);
    s->fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (s->fd >= 0 && fchmod(s->fd, 0600) == 0 &&
        bind(s->fd, (struct sockaddr *)&address, sizeof address) == 0 && lstat(s->path, &st) == 0 &&
        listen(s->fd, SOMAXCONN) == 0) {
        s->device = st.st_dev;
        s->inode = st.st_ino;
        return true;
    }
    sp_fail(err, SP_ERR_IO, s->path, "cannot listen: %s", strerror(errno));
    if (s->fd >= 0)
        close(s->fd);
    s->fd = -1;
    return false;
}

bool srv_unix_socket_open(const char *path, struct srv_unix_socket *s, struct sp_error *err) {
    *s = (struct srv_unix_socket){ .fd = -1 };
    snprintf(s->path, sizeof s->path, "%s", path);
    int lock = lock_folder(path, err);
    const bool ok = lock >= 0 && remove_stale(path, err) && listen_on(s, err);
    if (lock >= 0)
        close(lock);
    return ok;
}

void srv_unix_socket_close(struct srv_unix_socket *s) {
    struct stat st;
    if (s->fd < 0)
        return;
    if (lstat(s->path, &st) == 0 && st.st_dev == s->device && st.st_ino == s->inode)
        unlink(s->path);
    close(s->fd);
    s->fd = -1;
}
