/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/archive.h"

#include <archive.h>
#include <archive_entry.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { BLOCK = 64 * 1024, CAPACITY = 4 * BLOCK };

struct srv_archive {
    struct srv_folder folder;
    char id[65], extension[8];
    uint32_t count, next; /* next: the frame after the current one */
    struct archive *tar;
    int fd;        /* of the current frame; −1 = none */
    uint64_t left; /* bytes of the current frame that are not yet read */
    bool must_have_seal, is_closed;
    bool is_cancelled; /* discard further output */
    size_t start, end; /* the part of `bytes` that is not yet read */
    char bytes[CAPACITY];
};

static la_ssize_t on_write(struct archive *tar, void *user, const void *bytes, size_t size) {
    struct srv_archive *a = user;
    if (a->is_cancelled)
        return (la_ssize_t)size;
    if (size > CAPACITY - a->end) {
        archive_set_error(tar, ARCHIVE_FATAL, "the buffer is full");
        return ARCHIVE_FATAL;
    }
    memcpy(a->bytes + a->end, bytes, size);
    a->end += size;
    return (la_ssize_t)size;
}

struct srv_archive *srv_archive_create(const struct srv_folder *folder, const char *id,
                                       const char *extension, uint32_t count, bool sealed,
                                       struct sp_error *err) {
    struct srv_archive *a = calloc(1, sizeof *a);
    if (a) {
        a->folder = *folder;
        snprintf(a->id, sizeof a->id, "%s", id);
        snprintf(a->extension, sizeof a->extension, "%s", extension);
        a->count = count;
        a->must_have_seal = sealed;
        a->fd = -1;
        a->tar = archive_write_new();
    }
    if (a && a->tar && archive_write_set_format_ustar(a->tar) == ARCHIVE_OK &&
        archive_write_set_bytes_per_block(a->tar, 0) == ARCHIVE_OK &&
        archive_write_open(a->tar, a, NULL, on_write, NULL) == ARCHIVE_OK)
        return a;
    sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating an archive");
    srv_archive_destroy(&a);
    return NULL;
}

void srv_archive_destroy(struct srv_archive **archive) {
    struct srv_archive *a = *archive;
    *archive = NULL;
    if (!a)
        return;
    a->is_cancelled = true;
    archive_write_free(a->tar); /* also closes it; after archive_write_fail() this would leak */
    if (a->fd >= 0)
        close(a->fd);
    free(a);
}

/* Opens the next frame and writes its header. */
static bool begin_frame(struct srv_archive *a) {
    char name[32];
    struct stat st;
    snprintf(name, sizeof name, "%06u%s", a->next++, a->extension);
    a->fd = srv_folder_open_file(&a->folder, a->id, name, a->must_have_seal, &a->left, NULL);
    struct archive_entry *entry = archive_entry_new();
    bool ok = entry && a->fd >= 0 && fstat(a->fd, &st) == 0;
    if (ok) {
        archive_entry_set_pathname(entry, name);
        archive_entry_set_size(entry, (int64_t)a->left);
        archive_entry_set_mtime(entry, st.st_mtime, 0);
        archive_entry_set_filetype(entry, AE_IFREG);
        archive_entry_set_perm(entry, 0644);
        ok = archive_write_header(a->tar, entry) == ARCHIVE_OK;
    }
    archive_entry_free(entry);
    return ok;
}

/* Produces more output: a header, a block of a file, or the end. */
static bool advance(struct srv_archive *a) {
    char block[BLOCK];
    if (a->fd < 0 && a->next < a->count)
        return begin_frame(a);
    if (a->fd < 0) {
        a->is_closed = true;
        return archive_write_close(a->tar) == ARCHIVE_OK;
    }
    ssize_t n = read(a->fd, block, a->left < sizeof block ? (size_t)a->left : sizeof block);
    if (n > 0) {
        a->left -= (uint64_t)n;
        return archive_write_data(a->tar, block, (size_t)n) == n;
    }
    close(a->fd);
    a->fd = -1;
    return n == 0 && a->left == 0 && archive_write_finish_entry(a->tar) == ARCHIVE_OK;
}

ssize_t srv_archive_read(void *user, char *bytes, size_t size) {
    struct srv_archive *a = user;
    while (a->start == a->end && !a->is_closed) {
        a->start = a->end = 0;
        if (!advance(a))
            return -1;
    }
    size_t n = a->end - a->start < size ? a->end - a->start : size;
    memcpy(bytes, a->bytes + a->start, n);
    a->start += n;
    return (ssize_t)n;
}
