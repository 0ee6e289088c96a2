/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

bool sp_is_below(const char *root, const char *real) {
    size_t n = strlen(root);
    if (n == 1) /* "/" */
        return real[0] == '/' && real[1];
    return strncmp(root, real, n) == 0 && real[n] == '/' && real[n + 1];
}

/* No file has this name, and its end is no query. */
static bool fail_choices(struct sp_error *err, const char *title, const char *query) {
    static const char *const keys[] = { "level", "series", "as", "unit", "vectors", "field" };
    for (const char *at = query; *at; at += 1 + strcspn(at + 1, "&")) {
        const size_t length = strcspn(at + 1, "=&");
        bool is_known = false;
        for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
            is_known |= strlen(keys[i]) == length && strncmp(keys[i], at + 1, length) == 0;
        if (at[length + 1] == '=' && !is_known)
            return sp_fail(
                err, SP_ERR_NOT_FOUND, title,
                "there is no such file, and \"%.*s=\" is not known behind '?'; known are "
                "level=, series=, as=, unit=, vectors= and field=",
                length > 40 ? 40 : (int)length, at + 1);
        if (at[length + 1] == '=' && (!at[length + 2] || at[length + 2] == '&'))
            return sp_fail(err, SP_ERR_NOT_FOUND, title,
                           "there is no such file, and \"%.*s=\" needs a value; add it, or leave "
                           "\"%.*s=\" out",
                           (int)length, at + 1, (int)length, at + 1);
    }
    return sp_fail(
        err, SP_ERR_NOT_FOUND, title,
        "there is no such file, and \"%.60s\" cannot be read: give level=, series=, as=, "
        "unit=, vectors= and field= once each, the last two at the end, such as "
        "FILE?as=time&field=NAME",
        query);
}

bool sp_fail_missing(struct sp_error *err, const char *title) {
    const char *query = strrchr(title, '?');
    if (!*title)
        return sp_fail(err, SP_ERR_NOT_FOUND, title, "the name is empty; give a file or a folder");
    if (query && strchr(query, '=') && (strncmp(query, "?field=", 7) != 0 || !query[7]))
        return fail_choices(err, title, query);
    return sp_fail(
        err, SP_ERR_NOT_FOUND, title,
        strstr(title, ":/") || strstr(title, "?field=")
            ? "there is no such file; in a source with choices the array comes last, such "
              "as FILE.h5?as=time&field=/NAME"
            : "there is no such file");
}

void sp_tell_namer(struct sp_error *err, const char *namer) {
    const size_t used = err ? strlen(err->text) : 0;
    if (err && err->code == SP_ERR_NOT_FOUND)
        snprintf(err->text + used, sizeof err->text - used,
                 "; %.80s names it: put it there, or correct the name", namer);
}

static bool fail_errno(struct sp_error *err, int error, const char *title, const char *what) {
    if (error == ENOENT || error == ENOTDIR)
        return sp_fail_missing(err, title);
    if (error == ELOOP)
        return sp_fail(err, SP_ERR_INVALID, title, "is a symbolic link that leads in a circle");
    if (error == ENAMETOOLONG)
        return sp_fail(err, SP_ERR_INVALID, title,
                       "the path has more than %d bytes, or a name of it more than %d",
                       PATH_MAX - 1, NAME_MAX);
    return sp_fail(err, SP_ERR_IO, title, "cannot %s: %s", what, strerror(error));
}

/* The walk from "/" along a path, which only looks below the root: names above and beside the root
 * are followed as text. So nothing outside of the root is ever touched, and no answer depends on
 * what is there. openat2(RESOLVE_BENEATH) would refuse absolute links to places below the root, and
 * the seccomp filter cannot check its arguments. */
struct walk {
    const char *root;
    char *real;          /* the resolved part of the path; "" = "/" */
    char left[PATH_MAX]; /* the part to resolve */
    int fd;              /* of `real` if that is the root or below; -1 = not open */
    unsigned links;      /* followed */
};

static bool fail_with(int error) {
    errno = error;
    return false;
}

static bool is_root_or_below(const char *root, const char *real) {
    return strcmp(root, *real ? real : "/") == 0 || sp_is_below(root, real);
}

static void leave(struct walk *w) {
    const int error = errno;
    if (w->fd >= 0)
        close(w->fd);
    w->fd = -1;
    errno = error;
}

/* Opens the folder `real`, which the walk has resolved before: a link found now was created in the
 * meantime. */
static bool enter(struct walk *w) {
    const char *name = w->real + (*w->real ? strlen(w->root) : 0);
    w->fd = open(w->root, O_PATH | O_DIRECTORY | O_CLOEXEC);
    while (w->fd >= 0 && *name) {
        char part[NAME_MAX + 1];
        name += strspn(name, "/");
        snprintf(part, sizeof part, "%.*s", (int)strcspn(name, "/"), name);
        name += strcspn(name, "/");
        const int next = openat(w->fd, part, O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        leave(w);
        w->fd = next;
    }
    return w->fd >= 0 || fail_with(errno == ENOTDIR || errno == ELOOP ? ESTALE : errno);
}

/* Follows a link: puts its target before the part of the path that is still to be resolved. */
static bool follow(struct walk *w, int link, const char *rest) {
    enum { LINKS_MAX = 40 }; /* as Linux */
    char target[PATH_MAX], left[2 * PATH_MAX];
    const ssize_t size = readlinkat(link, "", target, sizeof target);
    if (size < 0)
        return false;
    if (++w->links > LINKS_MAX)
        return fail_with(ELOOP);
    const int n = snprintf(left, sizeof left, "%.*s%s", (int)size, target, rest);
    if (n >= PATH_MAX)
        return fail_with(ENAMETOOLONG);
    memcpy(w->left, left, (size_t)n + 1);
    if (target[0] == '/') {
        w->real[0] = 0;
        leave(w);
    }
    return true;
}

/* Opens `name` below the root, in the folder `real`. `rest` is the path behind it. */
static bool step(struct walk *w, const char *name, size_t used, const char *rest) {
    struct stat st;
    if (w->fd < 0 && !enter(w))
        return false;
    const int fd = openat(w->fd, name, O_PATH | O_NOFOLLOW | O_CLOEXEC);
    bool ok = fd >= 0 && fstat(fd, &st) == 0;
    if (ok && S_ISLNK(st.st_mode)) {
        ok = follow(w, fd, rest);
    } else if (ok && *rest && !S_ISDIR(st.st_mode)) {
        ok = fail_with(ENOTDIR);
    } else if (ok) {
        leave(w);
        w->fd = fd;
        sprintf(w->real + used, "/%s", name);
        memmove(w->left, rest, strlen(rest) + 1);
        return true;
    }
    const int error = errno;
    if (fd >= 0)
        close(fd);
    errno = error;
    return ok;
}

/* Takes the first name of what is left. */
static bool advance(struct walk *w) {
    char name[PATH_MAX];
    const size_t used = strlen(w->real), before = strspn(w->left, "/"),
                 size = strcspn(w->left + before, "/");
    const char *rest = w->left + before + size;
    memcpy(name, w->left + before, size);
    name[size] = 0;
    if (used + 1 + size >= PATH_MAX)
        return fail_with(ENAMETOOLONG);
    if (strcmp(name, "..") == 0) {
        char *slash = strrchr(w->real, '/');
        w->real[slash ? slash - w->real : 0] = 0;
        leave(w);
    } else if (size && strcmp(name, ".") != 0) {
        if (is_root_or_below(w->root, w->real))
            return step(w, name, used, rest);
        sprintf(w->real + used, "/%s", name);
    }
    memmove(w->left, rest, strlen(rest) + 1);
    return true;
}

/* Resolves all of a path. False with errno set; w->fd is open where the path ends at the root
 * or below. */
static bool walk(struct walk *w, const char *path) {
    const bool is_relative = path[0] != '/';
    w->real[0] = w->left[0] = 0;
    if (is_relative && !getcwd(w->left, sizeof w->left))
        return false;
    const size_t used = strlen(w->left);
    if (used + is_relative + strlen(path) >= sizeof w->left)
        return fail_with(ENAMETOOLONG);
    snprintf(w->left + used, sizeof w->left - used, "%s%s", is_relative ? "/" : "", path);
    while (*w->left)
        if (!advance(w))
            return false;
    if (is_root_or_below(w->root, w->real) && w->fd < 0 && !enter(w))
        return false;
    if (!*w->real)
        strcpy(w->real, "/");
    return true;
}

static const char *kind_name(mode_t mode) {
    return S_ISDIR(mode)    ? "a folder"
           : S_ISFIFO(mode) ? "a pipe"
           : S_ISSOCK(mode) ? "a socket"
           : S_ISCHR(mode)  ? "a character device"
           : S_ISBLK(mode)  ? "a block device"
                            : "not a regular file";
}

static bool fail_outside(struct sp_error *err, const struct walk *w, const char *title) {
    if (strcmp(w->root, w->real) == 0)
        return sp_fail(err, SP_ERR_DENIED, title, "is a folder, not a regular file");
    return sp_fail(err, SP_ERR_DENIED, title,
                   w->links ? "is a symbolic link that leads out of %s" : "lies outside of %s",
                   w->root);
}

/* Resolves a path and opens what it names without reading it. -1 with *err set. */
static int open_unread(const char *root, const char *path, const char *title, char real[PATH_MAX],
                       bool may_be_root, struct stat *st, struct sp_error *err) {
    struct walk w = { .root = root, .real = real, .fd = -1 };
    if (!walk(&w, path))
        fail_errno(err, errno, title, "open");
    else if (!sp_is_below(root, real) && !(may_be_root && strcmp(root, real) == 0))
        fail_outside(err, &w, title);
    else if (fstat(w.fd, st) != 0)
        fail_errno(err, errno, title, "look at the file");
    else
        return w.fd;
    leave(&w);
    return -1;
}

/* Opens for reading what `unread` refers to, which is closed. */
static int open_read(int unread, int flags, const char *title, struct sp_error *err) {
    char self[40];
    snprintf(self, sizeof self, "/proc/self/fd/%d", unread);
    const int fd = open(self, O_RDONLY | O_CLOEXEC | flags);
    if (fd < 0)
        sp_fail(err, SP_ERR_IO, title, "cannot open: %s", strerror(errno));
    close(unread);
    return fd;
}

int sp_open_confined(const char *root, const char *path, const char *title, char real[PATH_MAX],
                     uint64_t *size, struct sp_error *err) {
    struct stat st;
    const int unread = open_unread(root, path, title, real, false, &st, err);
    if (unread < 0)
        return -1;
    if (!S_ISREG(st.st_mode)) {
        sp_fail(err, SP_ERR_INVALID, title, "is %s, not a regular file", kind_name(st.st_mode));
        close(unread);
        return -1;
    }
    *size = (uint64_t)st.st_size;
    return open_read(unread, O_NONBLOCK | O_NOCTTY, title, err);
}

int sp_open_confined_folder(const char *root, const char *path, const char *title,
                            char real[PATH_MAX], struct sp_error *err) {
    struct stat st;
    const int unread = open_unread(root, path, title, real, true, &st, err);
    if (unread < 0)
        return -1;
    if (!S_ISDIR(st.st_mode)) {
        sp_fail(err, SP_ERR_INVALID, title, "is not a folder");
        close(unread);
        return -1;
    }
    return open_read(unread, O_DIRECTORY, title, err);
}
