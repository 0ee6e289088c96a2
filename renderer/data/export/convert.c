/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/convert.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/transfer.h"
#include "data/bricks/write.h"
#include "data/export/folder.h"
#include "data/import/launch.h"
#include "data/volume/grid.h"
#include "data/volume/procedural.h"
#include "sp/bricks.h"
#include "sp/log.h"

/* Share of the time in which the samples are read; the rest is writing. */
static const double read_share = 0.4;

struct progress {
    const struct sp_load_options *options;
    double from, share;
};

static bool report(void *user, double fraction) {
    const struct progress *p = user;
    return !p->options->progress ||
           p->options->progress(p->options->user, p->from + p->share * fraction);
}

/* Returns a file with the samples, as sp_import_samples(). */
static int read_samples(const char *source, const char *folder, bool keeps_axes,
                        const struct sp_load_options *options, struct sp_volume_info *info,
                        double **numbers, struct sp_error *err) {
    struct progress progress = { options, 0, read_share };
    struct sp_load_options own = *options;
    own.reserve = NULL;
    own.progress = report;
    own.user = &progress;
    if (!sp_source_is_demo(source))
        return sp_import_samples(source, &own, folder, keeps_axes, info, numbers, err);
    int fd = sp_temporary_file(folder, err);
    if (fd >= 0 && !sp_demo_stream(source, &own, fd, keeps_axes, info, numbers, err)) {
        close(fd);
        fd = -1;
    }
    return fd;
}

/* Gives the file its name, in place of an older one. It has none before, so that nothing is left
 * over if the process ends. */
static bool name_file(int file, const char *out, struct sp_error *err) {
    char own[32], *part;
    if (asprintf(&part, "%s.%ld.part", out, (long)getpid()) < 0)
        return sp_fail(err, SP_ERR_MEMORY, out, "out of memory for a path");
    snprintf(own, sizeof own, "/proc/self/fd/%d", file);
    bool ok = linkat(AT_FDCWD, own, AT_FDCWD, part, AT_SYMLINK_FOLLOW) == 0;
    if (ok && rename(part, out) != 0) {
        ok = false;
        unlink(part);
    }
    free(part);
    return ok || sp_fail(err, SP_ERR_IO, out, "cannot name the file: %s", strerror(errno));
}

/* For the brick cache: the file stands for the source, so it names its other fields and steps. */
static bool write_cached(const struct sp_export_job *job, struct sp_error *err) {
    const struct sp_bricks_write_job own = { .info = job->info,
                                             .samples = job->samples,
                                             .out = job->out,
                                             .folder = job->folder,
                                             .title = job->title,
                                             .progress = job->progress,
                                             .user = job->user };
    return sp_bricks_write(&own, err);
}

static bool write_bricks(const struct sp_export_job *job, struct sp_error *err) {
    struct sp_volume_info info = *job->info;
    memset(info.others, 0, sizeof info.others);
    memset(info.other_vectors, 0, sizeof info.other_vectors);
    info.steps = (struct sp_steps){ .count = 1 };
    struct sp_export_job own = *job;
    own.info = &info;
    return write_cached(&own, err);
}

/* A file that has its name when it is complete. */
static bool write_file(struct sp_export_job *job, sp_export_fn *write, struct sp_error *err) {
    job->out = open(job->folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
    if (job->out < 0)
        return sp_fail(err, SP_ERR_IO, job->folder, "cannot create a file: %s", strerror(errno));
    bool ok = write(job, err) && name_file(job->out, job->title, err);
    close(job->out);
    return ok;
}

/* Says early what would fail after the samples were read. A pipe or a device would be replaced by
 * the file. */
static bool check_place(const char *out, const char *folder, bool is_folder, struct sp_error *err) {
    struct stat st;
    if (access(folder, W_OK | X_OK) != 0)
        return sp_fail(err, SP_ERR_IO, out, "cannot write into the folder %s: %s", folder,
                       strerror(errno));
    if (is_folder)
        return sp_export_check_folder(out, err);
    return stat(out, &st) != 0 || S_ISREG(st.st_mode) ||
           sp_fail(err, SP_ERR_INVALID, out, "is there already, and is not a file");
}

/* A format, by how the name of the output ends. */
struct format {
    const char *suffix;
    sp_export_fn *write;
    bool is_folder;
    bool is_bricks;  /* it has vectors, rectilinear axes and all meanings */
    bool has_labels; /* it says that samples are labels */
};

static const struct format formats[] = {
    { .suffix = SP_BRICKS_SUFFIX, .write = write_bricks, .is_bricks = true },
    { .suffix = ".nrrd", .write = sp_export_nrrd },
    { .suffix = ".nii", .write = sp_export_nifti, .has_labels = true },
    { .suffix = ".nii.gz", .write = sp_export_nifti, .has_labels = true },
    { .suffix = ".vdb", .write = sp_export_vdb },
    { .suffix = ".zarr", .write = sp_export_zarr, .is_folder = true, .has_labels = true }
};

static bool convert(const char *source, const char *out, const struct format *format,
                    const struct sp_load_options *options, struct sp_volume_info *info,
                    struct sp_error *err) {
    static const struct sp_load_options none;
    char path[PATH_MAX], folder[PATH_MAX];
    size_t length = strlen(out);
    while (format->is_folder && length > 1 && out[length - 1] == '/')
        length--;
    if (length >= sizeof path)
        return sp_fail(err, SP_ERR_INVALID, out, "the path has %zu bytes; the limit is %zu", length,
                       sizeof path - 1);
    snprintf(path, sizeof path, "%.*s", (int)length, out);
    const char *slash = strrchr(path, '/');
    snprintf(folder, sizeof folder, "%.*s", slash ? (int)(slash - path) + 1 : 1,
             slash ? path : ".");
    if (!check_place(path, folder, format->is_folder, err))
        return false;
    options = options ? options : &none;
    double *numbers = NULL;
    int samples = read_samples(source, folder, format->is_bricks, options, info, &numbers, err);
    if (samples < 0)
        return false;
    struct progress progress = { options, read_share, 1 - read_share };
    struct sp_export_job job = { .info = info,
                                 .samples = samples,
                                 .folder = folder,
                                 .title = path,
                                 .progress = report,
                                 .user = &progress };
    bool ok = format->is_folder ? sp_export_folder(&job, format->write, err)
                                : write_file(&job, format->write, err);
    close(samples);
    free(numbers);
    info->steps.times = NULL;
    memset(info->grid.coordinates, 0, sizeof info->grid.coordinates);
    return ok;
}

bool sp_bricks_convert(const char *source, const char *out, const struct sp_load_options *options,
                       struct sp_error *err) {
    static const struct format cached = { .suffix = SP_BRICKS_SUFFIX,
                                          .write = write_cached,
                                          .is_bricks = true };
    struct sp_volume_info info;
    return convert(source, out, &cached, options, &info, err);
}

static bool has_suffix(const char *path, const struct format *format) {
    size_t length = strlen(path), end = strlen(format->suffix);
    while (format->is_folder && length > 0 && path[length - 1] == '/')
        length--;
    return length > end && path[length - end - 1] != '/' &&
           strncmp(path + length - end, format->suffix, end) == 0;
}

/* The format of a path; NULL = there is none. */
static const struct format *find_format(const char *out, struct sp_error *err) {
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++)
        if (has_suffix(out, &formats[i]))
            return &formats[i];
    sp_fail(err, SP_ERR_UNSUPPORTED, out,
            "does not end with a format that can be written: " SP_CONVERT_SUFFIXES);
    return NULL;
}

bool sp_convert_check(const char *out, struct sp_error *err) {
    return find_format(out, err) != NULL;
}

/* Says what the reader changed, and what the output does not have. */
static void warn(const char *source, const struct format *format,
                 const struct sp_volume_info *info) {
    for (int i = 0; i < SP_WARNINGS_MAX && info->warnings[i][0]; i++)
        sp_log(SP_LOG_WARN, "%s: %s", source, info->warnings[i]);
    if (info->steps.count > 1)
        sp_log(SP_LOG_WARN, "%s: of %u time steps only number %u is written", source,
               info->steps.count, info->steps.index);
    if (info->vector_bytes && !format->is_bricks)
        sp_log(SP_LOG_WARN, "%s: the vectors \"%s\" are left out", source, info->vector_name);
    const bool are_labels = info->meaning == SP_MEANING_LABELS;
    if (info->meaning != SP_MEANING_UNKNOWN && !format->is_bricks &&
        !(are_labels && format->has_labels))
        sp_log(SP_LOG_WARN, "%s: the output does not say that the samples are %s%s", source,
               are_labels                              ? "labels"
               : info->meaning == SP_MEANING_STATISTIC ? "results of a statistical test"
                                                       : "distances from a surface",
               are_labels ? "; open it with ?as=labels" : "");
    if (info->others[0][0])
        sp_log(SP_LOG_WARN,
               "%s: only \"%s\" is written; SOURCE?field=NAME chooses another, such as \"%s\"",
               source, info->value_name, info->others[0]);
}

bool sp_convert(const char *source, const char *out, const struct sp_load_options *options,
                struct sp_error *err) {
    const struct format *format = find_format(out, err);
    struct sp_volume_info info;
    if (!format || !convert(source, out, format, options, &info, err))
        return false;
    warn(source, format, &info);
    return true;
}
