/* SPDX-License-Identifier: Apache-2.0
 *
 * Files of formats that libraries read: OpenVDB, PNG, JPEG, TIFF, HDF5, NetCDF. The file goes the
 * way that the daemon takes: through the process splat-import. The library may crash there. What
 * must hold:
 *
 *   - the load ends with a volume, or with an error that says why, within its time
 *   - all samples of the volume can be read
 *   - no process and no descriptor is left over
 *   - under ASan: what crashed the process is the library, not a function of renderer/
 */
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "sp/volume.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum {
    TIMEOUT_MS = SPLATD_IS_REPLAY ? 60000 : 5000, /* sound files must load even on a busy machine */
    READ_MAX = 1 << 20,                           /* bytes of samples */
    REPORT_MAX = 1 << 16
};

static char folder[64];

static void fail(const char *why) {
    fprintf(stderr, "%s\n", why);
    abort();
}

static void remove_folder(void) {
    DIR *dir = opendir(folder);
    for (const struct dirent *entry; dir && (entry = readdir(dir));)
        unlinkat(dirfd(dir), entry->d_name, 0);
    if (dir)
        closedir(dir);
    rmdir(folder);
}

/* Reports of the sanitizers in the child go to files. What a library leaks is no fault of ours. */
static void set_up(void) {
    char options[256];
    snprintf(folder, sizeof folder, "/tmp/splat-fuzz-XXXXXX");
    if (!mkdtemp(folder))
        fail("cannot make a folder");
    atexit(remove_folder);
    snprintf(options, sizeof options,
             "log_path=%s/report:allocator_may_return_null=1:max_allocation_size_mb=512:"
             "hard_rss_limit_mb=1024:detect_leaks=0:handle_abort=1",
             folder);
    setenv("ASAN_OPTIONS", options, 1);
}

static bool refuse_large(void *user, uint64_t bytes, struct sp_error *err) {
    (void)user;
    if (bytes <= READ_MAX)
        return true;
    *err = (struct sp_error){ .code = SP_ERR_BUDGET, .text = "too large for this test" };
    return false;
}

static unsigned count_descriptors(void) {
    unsigned count = 0;
    DIR *dir = opendir("/proc/self/fd");
    while (dir && readdir(dir))
        count++;
    if (dir)
        closedir(dir);
    return count;
}

/* Counts the child processes of this thread. libFuzzer may also run one, a symbolizer. */
static unsigned count_processes(void) {
    unsigned count = 0;
    int pid;
    FILE *file = fopen("/proc/thread-self/children", "r");
    while (file && fscanf(file, "%d", &pid) == 1)
        count++;
    if (file)
        fclose(file);
    return count;
}

/* The end of the file's name; readers know most files by their first bytes. */
static const char *suffix_of(const uint8_t *data, size_t size) {
    static const struct {
        const char *start, *suffix;
        size_t bytes;
    } known[] = { { "\x89PNG", ".png", 4 }, { "\xff\xd8", ".jpg", 2 }, { "\x89HDF", ".h5", 4 },
                  { "CDF", ".nc", 3 },      { " BDV", ".vdb", 4 },     { "II", ".tif", 2 },
                  { "MM", ".tif", 2 } };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (size >= known[i].bytes && memcmp(data, known[i].start, known[i].bytes) == 0)
            return i == 2 && size % 2 ? ".nc" : known[i].suffix; /* NetCDF-4 is HDF5 */
    return ".png";
}

/* True if a line of a stack names a function of a sanitizer or of the C library. */
static bool is_helper(const char *line) {
    static const char *const parts[] = { "interceptor", "sanitizer",    " in __asan",
                                         " in __ubsan", "compiler-rt",  "/libc.so",
                                         "/libstdc++",  "operator new", "operator delete" };
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        if (strstr(line, parts[i]))
            return true;
    return false;
}

/* True if a report of a sanitizer blames a function of this project: UBSan only sees these, and
 * ASan names it first in the stack. */
static bool is_own_fault(char *report) {
    bool is_stack = false;
    for (char *line = strtok(report, "\n"); line; line = strtok(NULL, "\n")) {
        if (strstr(line, "runtime error:"))
            return true;
        is_stack = is_stack || strstr(line, "ERROR: ");
        if (!is_stack || !strstr(line, " in ") || !strstr(line, "    #") || is_helper(line))
            continue;
        return strstr(line, "/renderer/") != NULL;
    }
    return false;
}

/* Reads and removes the reports of the child. */
static void check_reports(void) {
    static char report[REPORT_MAX];
    DIR *dir = opendir(folder);
    for (const struct dirent *entry; dir && (entry = readdir(dir));) {
        char path[512];
        if (strncmp(entry->d_name, "report", 6) != 0)
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        FILE *file = fopen(path, "r");
        report[file ? fread(report, 1, sizeof report - 1, file) : 0] = 0;
        if (file)
            fclose(file);
        unlink(path);
        char copy[1024];
        snprintf(copy, sizeof copy, "%s", report);
        if (is_own_fault(report)) {
            fprintf(stderr, "the reader failed in this project:\n%s\n", copy);
            abort();
        }
    }
    if (dir)
        closedir(dir);
}

static volatile unsigned char sink;

/* Reads every byte of the samples. */
static void check_volume(const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const unsigned char *voxels = sp_volume_voxels(volume);
    uint64_t count = 1;
    for (int a = 0; a < 3; a++)
        count *= info->grid.dims[a];
    if (info->elements.kind != SP_KIND_GRID ||
        count * sp_type_size(info->type) != info->voxel_bytes)
        fail("the volume has another size than its samples");
    for (uint64_t i = 0; i < info->voxel_bytes; i++)
        sink = voxels[i];
}

/* The corpus, which builds without libFuzzer replay, is sound; but a module may be missing. */
static void check_error(const struct sp_error *err) {
    if (SPLATD_IS_REPLAY && err->code != SP_ERR_UNSUPPORTED) {
        fprintf(stderr, "%s: %s\n", err->place, err->text);
        abort();
    }
    if (err->code == SP_OK || !err->text[0] || !strstr(err->place, folder)) {
        fprintf(stderr, "code %d, place \"%s\": %s\n", (int)err->code, err->place, err->text);
        abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const struct sp_load_options options = { .reserve = refuse_large,
                                             .timeout_ms = TIMEOUT_MS,
                                             .importer = SPLATD_BIN_DIR "/splat-import" };
    struct sp_error err = { .code = SP_OK };
    char path[128];
    if (!folder[0])
        set_up();
    snprintf(path, sizeof path, "%s/input%s", folder, suffix_of(data, size));
    FILE *file = fopen(path, "wb");
    if (!file || fwrite(data, 1, size, file) != size || fclose(file) != 0)
        fail("cannot write the file");
    const unsigned descriptors = count_descriptors(), processes = count_processes();
    struct sp_volume *volume = sp_volume_load(path, &options, &err);
    if (volume)
        check_volume(volume);
    else
        check_error(&err);
    sp_volume_unref(&volume);
    if (count_descriptors() != descriptors)
        fail("a descriptor is left over");
    if (count_processes() != processes)
        fail("a process is left over");
    check_reports();
    unlink(path);
    return 0;
}
