/* SPDX-License-Identifier: Apache-2.0
 *
 * The store of uploads on a disk that fails: full, short writes, errors of every call; and owners,
 * limits, expiry, replaced writers, headers with companions, and restarts.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

#include "uploads/uploads.h"

static struct {
    unsigned calls, fails_at; /* counted from 1; 0 = no call fails */
    int error;                /* 0 = the write is short, and the next one fails with ENOSPC */
} disk;

ssize_t __real_pwrite(int fd, const void *bytes, size_t size, off_t at);
ssize_t __wrap_pwrite(int fd, const void *bytes, size_t size, off_t at);
int __real_rename(const char *from, const char *to);
int __wrap_rename(const char *from, const char *to);
int __real_fdatasync(int fd);
int __wrap_fdatasync(int fd);

static bool fails(void) {
    if (disk.fails_at == 0 || ++disk.calls != disk.fails_at)
        return false;
    errno = disk.error ? disk.error : ENOSPC;
    return true;
}

ssize_t __wrap_pwrite(int fd, const void *bytes, size_t size, off_t at) {
    if (!fails())
        return __real_pwrite(fd, bytes, size, at);
    if (disk.error)
        return -1;
    disk.fails_at = disk.calls + 1;
    disk.error = ENOSPC;
    return __real_pwrite(fd, bytes, size / 2, at);
}

int __wrap_rename(const char *from, const char *to) {
    return fails() ? -1 : __real_rename(from, to);
}

int __wrap_fdatasync(int fd) {
    return fails() ? -1 : __real_fdatasync(fd);
}

static char folder[64];
static struct srv_work_queue *queue;
static struct srv_tokens *tokens; /* NULL = no quotas */

static void set_disk(unsigned fails_at, int error) {
    disk.calls = 0;
    disk.fails_at = fails_at;
    disk.error = error;
}

static struct srv_uploads *create(double expiry_ms) {
    const struct srv_uploads_options options = { .folder = folder,
                                                 .bytes_max = 1000,
                                                 .count_max = 3,
                                                 .expiry_ms = expiry_ms,
                                                 .begin_ms = expiry_ms / 2,
                                                 .tokens = tokens,
                                                 .disk = queue };
    struct sp_error err = { .text = "" };
    struct srv_uploads *uploads = srv_uploads_create(&options, 0, &err);
    if (!uploads)
        fail_msg("%s: %s", err.place, err.text);
    return uploads;
}

static int set_up(void **state) {
    (void)state;
    strcpy(folder, "/tmp/splatd-uploads-unit-XXXXXX");
    queue = srv_work_queue_create("test", 0, NULL);
    return mkdtemp(folder) && queue ? 0 : -1;
}

static unsigned count_folders(void) {
    unsigned count = 0;
    DIR *entries = opendir(folder);
    assert_non_null(entries);
    for (struct dirent *entry; (entry = readdir(entries));)
        count += entry->d_name[0] != '.';
    closedir(entries);
    return count;
}

/* Runs what the disk thread has to do. */
static void drain(void) {
    srv_work_queue_destroy(&queue);
    assert_non_null(queue = srv_work_queue_create("test", 0, NULL));
}

static int tear_down(void **state) {
    (void)state;
    char command[96];
    srv_work_queue_destroy(&queue);
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    return system(command);
}

static bool try_add(struct srv_uploads *uploads, const char *owner, uint64_t bytes,
                    struct srv_upload_info *info, struct sp_error *err) {
    const struct srv_upload_request request = {
        .owner = owner, .name = "a.nrrd", .extension = ".nrrd", .bytes = bytes
    };
    return srv_uploads_add(uploads, &request, 0, info, err);
}

static void add(struct srv_uploads *uploads, uint64_t bytes, struct srv_upload_info *info) {
    struct sp_error err;
    if (!try_add(uploads, "ann", bytes, info, &err))
        fail_msg("%s", err.text);
}

/* Adds "ann"'s companion of a header. */
static bool try_join(struct srv_uploads *uploads, const char *header, const char *name,
                     uint64_t bytes, struct srv_upload_info *info, struct sp_error *err) {
    const struct srv_upload_request request = {
        .owner = "ann", .name = name, .header = header, .bytes = bytes
    };
    return srv_uploads_add(uploads, &request, 0, info, err);
}

static void begin(struct srv_uploads *uploads, const char *id, uint64_t offset, bool is_atomic,
                  struct srv_upload_writer *writer) {
    struct sp_error err;
    uint64_t at;
    if (!srv_upload_begin(uploads, id, "ann", offset, 0, is_atomic, writer, &at, &err))
        fail_msg("%s", err.text);
}

static uint64_t offset_of(struct srv_uploads *uploads, const char *id) {
    struct srv_upload_info info;
    assert_true(srv_uploads_get(uploads, id, "ann", 0, &info, NULL));
    return info.offset;
}

/* Any call may fail: the upload reports an error, never has a wrong offset, and can continue. */
static void a_disk_that_fails(void **state) {
    (void)state;
    static const int errors[] = { ENOSPC, EIO, 0 };
    static const char bytes[] = "0123456789";
    for (size_t e = 0; e < sizeof errors / sizeof *errors; e++) {
        bool has_failed = true;
        for (unsigned n = 1; has_failed; n++) {
            struct srv_uploads *uploads = create(1000);
            struct srv_upload_info info;
            struct srv_upload_writer writer;
            struct sp_error err = { .code = SP_OK };
            set_disk(n, errors[e]);
            bool ok = try_add(uploads, "ann", 10, &info, &err);
            if (!ok) {
                assert_int_equal(err.code, errors[e] == EIO ? SP_ERR_IO : SP_ERR_BUDGET);
                assert_int_equal(count_folders(), 0);
                srv_uploads_destroy(&uploads);
                continue;
            }
            begin(uploads, info.id, 0, false, &writer);
            ok = srv_upload_write(&writer, bytes, 10, 0, &err);
            struct sp_error *end_err = ok ? &err : NULL;
            ok = srv_upload_end(&writer, true, 0, &info, end_err) && ok;
            has_failed = disk.calls >= n;
            assert_true(ok || has_failed);
            if (!ok)
                assert_int_equal(err.code, errors[e] == EIO ? SP_ERR_IO : SP_ERR_BUDGET);
            set_disk(0, 0);
            uint64_t at = offset_of(uploads, writer.id);
            assert_true(at == 0 || at == 10);
            begin(uploads, writer.id, at, false, &writer); /* it continues */
            assert_true(srv_upload_write(&writer, bytes + at, 10 - at, 0, NULL));
            assert_true(srv_upload_end(&writer, true, 0, &info, NULL));
            assert_int_equal(info.offset, 10);
            assert_true(srv_uploads_remove(uploads, writer.id, "ann", NULL));
            drain();
            assert_int_equal(count_folders(), 0);
            srv_uploads_destroy(&uploads);
        }
    }
}

static void limits_and_expiry(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(100);
    struct srv_upload_info info;
    struct sp_error err;
    assert_false(try_add(uploads, "ann", 1001, &info, &err));
    assert_int_equal(err.code, SP_ERR_TOO_LARGE);
    assert_string_equal(err.place, "/bytes");
    add(uploads, 900, &info);
    assert_false(try_add(uploads, "ann", 101, &info, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    add(uploads, 50, &info);
    add(uploads, 50, &info);
    assert_false(try_add(uploads, "ann", 0, &info, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    struct srv_upload_writer writer;
    begin(uploads, info.id, 0, false, &writer);
    assert_true(srv_upload_write(&writer, "x", 1, 40, NULL)); /* used at 40 ms */
    srv_uploads_tick(uploads, 49);
    struct srv_uploads_numbers numbers;
    srv_uploads_numbers(uploads, "ann", &numbers);
    assert_int_equal(numbers.count, 3);
    srv_uploads_tick(uploads, 50); /* uploads without a byte expire after half the time */
    srv_uploads_numbers(uploads, "ann", &numbers);
    assert_int_equal(numbers.count, 1);
    assert_int_equal(numbers.declared_bytes, 50);
    srv_uploads_tick(uploads, 139);
    assert_true(srv_uploads_get(uploads, writer.id, NULL, 139, &info, NULL));
    srv_uploads_tick(uploads, 140);
    assert_false(srv_upload_write(&writer, "x", 1, 160, &err)); /* it expired meanwhile */
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
    assert_false(srv_upload_end(&writer, true, 160, &info, &err));
    drain();
    assert_int_equal(count_folders(), 0);
    srv_uploads_destroy(&uploads);
}

static void writers_replace_each_other(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(1000);
    struct srv_upload_info info;
    struct srv_upload_writer old, new;
    struct sp_error err;
    uint64_t at = 0;
    add(uploads, 10, &info);
    begin(uploads, info.id, 0, false, &old);
    assert_true(srv_upload_write(&old, "012", 3, 0, NULL));
    assert_false(srv_upload_begin(uploads, info.id, NULL, 0, 0, false, &new, &at, &err));
    assert_int_equal(at, 3);
    assert_false(srv_upload_begin(uploads, info.id, NULL, 3, 8, false, &new, &at, &err));
    assert_int_equal(err.code, SP_ERR_TOO_LARGE); /* more than is missing */
    begin(uploads, info.id, 3, false, &new);
    assert_false(srv_upload_write(&old, "zz", 2, 0, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    assert_false(srv_upload_end(&old, true, 0, &info, NULL));
    assert_false(srv_upload_write(&new, "34567890", 8, 0, &err)); /* 8 > 7 */
    assert_int_equal(err.code, SP_ERR_TOO_LARGE);
    assert_true(srv_upload_write(&new, "3456789", 7, 0, NULL));
    assert_true(srv_upload_end(&new, true, 0, &info, NULL));
    assert_int_equal(info.offset, 10);
    srv_uploads_destroy(&uploads);
}

/* Bytes without their checksum do not count, neither now nor after a restart. */
static void a_restart_finds_what_counts(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(1000);
    struct srv_upload_info info;
    struct srv_upload_writer writer;
    char path[PATH_MAX], name[SRV_UPLOAD_NAME_BYTES], id[SRV_UPLOAD_ID_BYTES];
    struct sp_error err;
    add(uploads, 10, &info);
    memcpy(id, info.id, sizeof id);
    begin(uploads, id, 0, false, &writer);
    assert_true(srv_upload_write(&writer, "01234", 5, 0, NULL));
    assert_true(srv_upload_end(&writer, true, 0, &info, NULL));
    begin(uploads, id, 5, true, &writer);
    assert_true(srv_upload_write(&writer, "zzz", 3, 0, NULL));
    assert_int_equal(offset_of(uploads, id), 5);
    close(writer.fd); /* the process is killed here */
    srv_uploads_destroy(&uploads);
    snprintf(path, sizeof path, "%s/%032d", folder, 7); /* a folder without its files */
    assert_int_equal(mkdir(path, 0700), 0);
    uploads = create(1000);
    assert_int_equal(count_folders(), 1);
    assert_int_equal(offset_of(uploads, id), 5);
    assert_false(srv_upload_open(uploads, id, path, name, &err));
    assert_int_equal(err.code, SP_ERR_NOT_READY);
    begin(uploads, id, 5, true, &writer);
    assert_true(srv_upload_write(&writer, "zzzzz", 5, 0, NULL));
    assert_true(srv_upload_end(&writer, false, 0, &info, NULL)); /* a wrong checksum */
    assert_int_equal(info.offset, 5);
    begin(uploads, id, 5, true, &writer);
    assert_true(srv_upload_write(&writer, "56789", 5, 0, NULL));
    assert_true(srv_upload_end(&writer, true, 0, &info, NULL));
    assert_true(srv_upload_open(uploads, id, path, name, NULL));
    char bytes[16] = "";
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    assert_int_equal(fread(bytes, 1, sizeof bytes, file), 10);
    fclose(file);
    assert_string_equal(bytes, "0123456789");
    assert_false(srv_uploads_remove(uploads, id, NULL, &err)); /* it belongs to a volume */
    srv_uploads_tick(uploads, 1e9);
    srv_upload_close(uploads, id, SRV_UPLOAD_LOADED);
    drain();
    assert_int_equal(count_folders(), 0);
    srv_uploads_destroy(&uploads);
}

/* Reads the rest of a file into `bytes`, which is cleared before. */
static void read_file(const char *path, char bytes[32]) {
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    memset(bytes, 0, 32);
    assert_true(fread(bytes, 1, 31, file) > 0);
    fclose(file);
}

static void fill(struct srv_uploads *uploads, const char *id, const char *bytes) {
    struct srv_upload_info info;
    struct srv_upload_writer writer;
    begin(uploads, id, 0, false, &writer);
    assert_true(srv_upload_write(&writer, bytes, strlen(bytes), 0, NULL));
    assert_true(srv_upload_end(&writer, true, 0, &info, NULL));
}

/* Only the owner and an admin find an upload, also after a restart. */
static void an_upload_has_an_owner(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(1000);
    struct srv_upload_info info;
    struct srv_upload_writer writer;
    struct sp_error err;
    uint64_t at;
    add(uploads, 10, &info);
    for (int run = 0; run < 2; run++) {
        assert_false(srv_uploads_get(uploads, info.id, "bob", 0, &info, &err));
        assert_int_equal(err.code, SP_ERR_NOT_FOUND);
        assert_false(srv_uploads_at(uploads, 0, "bob", 0, &info));
        assert_true(srv_uploads_at(uploads, 0, "ann", 0, &info));
        assert_true(srv_uploads_at(uploads, 0, NULL, 0, &info));
        assert_false(srv_upload_begin(uploads, info.id, "bob", 0, 0, false, &writer, &at, &err));
        assert_int_equal(err.code, SP_ERR_NOT_FOUND);
        assert_false(srv_uploads_remove(uploads, info.id, "bob", &err));
        assert_int_equal(err.code, SP_ERR_NOT_FOUND);
        srv_uploads_destroy(&uploads);
        uploads = create(1000);
    }
    assert_true(srv_uploads_remove(uploads, info.id, NULL, NULL));
    drain();
    srv_uploads_destroy(&uploads);
}

static void set_tokens(const char *text) {
    struct srv_token *list;
    size_t count;
    struct sp_error err;
    if (!tokens)
        assert_non_null(tokens = srv_tokens_create(NULL));
    if (!srv_token_file_parse(text, strlen(text), &list, &count, &err))
        fail_msg("%s: %s", err.place, err.text);
    assert_true(srv_tokens_set(tokens, list, count, NULL));
}

#define ANN "ann-ann-ann-ann-ann name=ann role=control"
#define BOB "bob-bob-bob-bob-bob name=bob role=control"

/* One token cannot take all: neither bytes nor uploads. */
static void a_token_has_a_share(void **state) {
    (void)state;
    struct srv_upload_info info;
    struct srv_uploads_numbers numbers;
    struct sp_error err;
    set_tokens(ANN "\n" BOB "\n");
    struct srv_uploads *uploads = create(1000);
    assert_false(try_add(uploads, "ann", 751, &info, &err));
    assert_int_equal(err.code, SP_ERR_TOO_LARGE);
    assert_true(try_add(uploads, "ann", 700, &info, &err));
    assert_false(try_add(uploads, "ann", 51, &info, &err));
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_non_null(strstr(err.text, "so 50 are free"));
    srv_uploads_numbers(uploads, "bob", &numbers);
    assert_int_equal(numbers.free_bytes, 225); /* three quarters of what is free */
    assert_true(try_add(uploads, "bob", 200, &info, &err));
    assert_false(try_add(uploads, "bob", 26, &info, &err)); /* something is left for others */
    assert_int_equal(err.code, SP_ERR_QUOTA);
    srv_uploads_numbers(uploads, "ann", &numbers);
    assert_int_equal(numbers.own_bytes, 700);
    assert_int_equal(numbers.own_bytes_max, 750);
    assert_int_equal(numbers.free_bytes, 0);
    assert_int_equal(numbers.declared_bytes, 900);
    set_tokens(ANN " uploads=1 upload-bytes=2000\n" BOB "\n"); /* more than there is */
    assert_false(try_add(uploads, "ann", 1, &info, &err));
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_non_null(strstr(err.text, "has 1 uploads and may have 1"));
    set_tokens(ANN "\n"); /* alone, it may have all */
    srv_uploads_numbers(uploads, "ann", &numbers);
    assert_int_equal(numbers.own_bytes_max, 1000);
    drain();
    srv_uploads_destroy(&uploads);
    srv_tokens_destroy(&tokens);
}

/* The samples of a header lie beside it, under their own names, and live and die with it. */
static void a_header_has_companions(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(1000);
    struct srv_upload_info header, other, info;
    struct sp_error err;
    char path[PATH_MAX], name[SRV_UPLOAD_NAME_BYTES], bytes[32];
    add(uploads, 4, &header);
    assert_true(try_join(uploads, header.id, "ct.raw", 3, &info, &err));
    assert_string_equal(info.header, header.id);
    assert_false(try_join(uploads, header.id, "ct.raw", 3, &other, &err)); /* the name is taken */
    assert_string_equal(err.place, "/name");
    assert_false(try_join(uploads, header.id, "data.nrrd", 3, &other, &err));
    assert_string_equal(err.place, "/name");
    assert_false(try_join(uploads, info.id, "b.raw", 3, &other, &err)); /* of a companion */
    assert_string_equal(err.place, "/header");
    fill(uploads, header.id, "head");
    assert_false(srv_upload_open(uploads, header.id, path, name, &err));
    assert_int_equal(err.code, SP_ERR_NOT_READY);
    assert_non_null(strstr(err.text, "'ct.raw' has 0 of 3"));
    srv_uploads_destroy(&uploads);
    uploads = create(1000); /* a restart keeps them together */
    fill(uploads, info.id, "abc");
    assert_false(srv_upload_open(uploads, info.id, path, name, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_true(srv_upload_open(uploads, header.id, path, name, &err));
    assert_string_equal(name, "a.nrrd");
    read_file(path, bytes);
    assert_string_equal(bytes, "head");
    strcpy(strrchr(path, '/'), "/ct.raw");
    read_file(path, bytes);
    assert_string_equal(bytes, "abc");
    assert_false(try_join(uploads, header.id, "late.raw", 3, &other, &err));
    assert_int_equal(err.code, SP_ERR_NOT_READY);
    assert_false(srv_uploads_remove(uploads, info.id, NULL, &err));
    assert_int_equal(err.code, SP_ERR_NOT_READY);
    srv_upload_close(uploads, header.id, SRV_UPLOAD_RETURNED);
    assert_true(srv_uploads_remove(uploads, info.id, NULL, &err));
    assert_int_equal(access(path, F_OK), -1); /* at once: the name may be used again */
    assert_true(try_join(uploads, header.id, "ct.raw", 2, &info, &err));
    drain();
    srv_uploads_destroy(&uploads);
    uploads = create(1000);
    fill(uploads, info.id, "xy");
    read_file(path, bytes);
    assert_string_equal(bytes, "xy");
    assert_true(srv_upload_open(uploads, header.id, path, name, &err));
    srv_upload_close(uploads, header.id, SRV_UPLOAD_LOADED);
    drain();
    assert_int_equal(count_folders(), 0);
    srv_uploads_destroy(&uploads);
}

/* Slices, and headers and samples of NIfTI, find each other by their names. */
static void some_files_keep_their_names(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(1000);
    struct srv_upload_request request = {
        .name = "s1.png", .extension = ".png", .bytes = 4, .owner = "ann"
    };
    struct srv_upload_info header, info;
    struct sp_error err;
    char path[PATH_MAX], name[SRV_UPLOAD_NAME_BYTES];
    assert_true(srv_uploads_add(uploads, &request, 0, &header, &err));
    assert_true(try_join(uploads, header.id, "s2.png", 3, &info, &err));
    assert_false(try_join(uploads, header.id, "s1.png", 3, &info, &err));
    assert_string_equal(err.place, "/name");
    fill(uploads, header.id, "head");
    fill(uploads, info.id, "abc");
    srv_uploads_destroy(&uploads);
    uploads = create(1000);
    assert_true(srv_upload_open(uploads, header.id, path, name, &err));
    assert_string_equal(strrchr(path, '/'), "/s1.png");
    assert_int_equal(access(path, F_OK), 0);
    strcpy(strrchr(path, '/'), "/s2.png");
    assert_int_equal(access(path, F_OK), 0);
    srv_upload_close(uploads, header.id, SRV_UPLOAD_RETURNED);
    srv_uploads_destroy(&uploads);
}

/* The bytes of a companion keep its header; a companion without any goes alone. */
static void a_set_expires_together(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(100);
    struct srv_upload_info header, used, idle, info;
    struct srv_upload_writer writer;
    add(uploads, 4, &header);
    fill(uploads, header.id, "head");
    assert_true(try_join(uploads, header.id, "used.raw", 5, &used, NULL));
    assert_true(try_join(uploads, header.id, "idle.raw", 5, &idle, NULL));
    begin(uploads, used.id, 0, true, &writer); /* with a checksum: nothing counts yet */
    assert_true(srv_upload_write(&writer, "abc", 3, 40, NULL));
    srv_uploads_tick(uploads, 60);
    assert_false(srv_uploads_get(uploads, idle.id, NULL, 60, &info, NULL));
    srv_uploads_tick(uploads, 139);
    assert_true(srv_uploads_get(uploads, header.id, NULL, 139, &info, NULL));
    assert_true(srv_uploads_get(uploads, used.id, NULL, 139, &info, NULL));
    assert_int_equal(info.expires_ms, 1);
    srv_uploads_tick(uploads, 140);
    assert_false(srv_upload_end(&writer, true, 140, &info, NULL));
    drain();
    assert_int_equal(count_folders(), 0);
    srv_uploads_destroy(&uploads);
}

/* A companion whose header was lost cannot be continued, and no info leads out of the folder. */
static void a_restart_trusts_no_file(void **state) {
    (void)state;
    struct srv_uploads *uploads = create(1000);
    struct srv_upload_info header, info;
    char path[PATH_MAX];
    add(uploads, 4, &header);
    assert_true(try_join(uploads, header.id, "ct.raw", 3, &info, NULL));
    srv_uploads_destroy(&uploads);
    snprintf(path, sizeof path, "%s/%s/info", folder, info.id);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fprintf(file,
            "{\"name\":\"../info\",\"owner\":\"ann\",\"extension\":\"\",\"header\":\"%s\","
            "\"bytes\":3,\"offset\":0}",
            header.id);
    fclose(file);
    uploads = create(1000);
    assert_int_equal(count_folders(), 1);
    assert_true(try_join(uploads, header.id, "ct.raw", 3, &info, NULL));
    srv_uploads_destroy(&uploads);
    snprintf(path, sizeof path, "%s/%s/info", folder, header.id);
    assert_int_equal(unlink(path), 0);
    uploads = create(1000);
    assert_int_equal(count_folders(), 0);
    srv_uploads_destroy(&uploads);
}

static void names_are_safe(void **state) {
    (void)state;
    static const char *const cases[][2] = {
        { "../../etc/passwd.nrrd", "passwd.nrrd" },
        { "C:\\scans\\größe.tif", "größe.tif" },
        { "a\nb\x7f.vti", "a b .vti" },
        { ".nrrd", ".nrrd" },
        { "ct\u202edrrn.nrrd", "ct drrn.nrrd" },
        { "a\u200bb\u2066c\ufeffd\U000e0041e.raw", "a b c d e.raw" },
        { "نمونه\u200cها.nrrd", "نمونه\u200cها.nrrd" }, /* Persian is written with this one */
        { "broken\xe2\x80", "broken\xe2\x80" },
    };
    char name[SRV_UPLOAD_NAME_BYTES], long_name[400] = "";
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_true(srv_upload_name(cases[i][0], strlen(cases[i][0]), name, NULL));
        assert_string_equal(name, cases[i][1]);
    }
    static const char *const none[] = { "a/", "", "a/..", ".", "\u202e" };
    for (size_t i = 0; i < sizeof none / sizeof *none; i++)
        assert_false(srv_upload_name(none[i], strlen(none[i]), name, NULL));
    for (int i = 0; i < 150; i++)
        strcat(long_name, "ä");
    strcat(long_name, ".nrrd");
    assert_true(srv_upload_name(long_name, strlen(long_name), name, NULL));
    assert_int_equal(strlen(name) % 2, 1); /* whole characters and ".nrrd" */
    assert_string_equal(name + strlen(name) - 7, "ä.nrrd");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_disk_that_fails, set_up, tear_down),
        cmocka_unit_test_setup_teardown(limits_and_expiry, set_up, tear_down),
        cmocka_unit_test_setup_teardown(writers_replace_each_other, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_restart_finds_what_counts, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_upload_has_an_owner, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_token_has_a_share, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_header_has_companions, set_up, tear_down),
        cmocka_unit_test_setup_teardown(some_files_keep_their_names, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_set_expires_together, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_restart_trusts_no_file, set_up, tear_down),
        cmocka_unit_test(names_are_safe),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
