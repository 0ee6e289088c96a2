/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/imaris.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "data/volume/unit.h"

enum { LEVELS_MAX = 32, TIMES_MAX = ARRAYS_MAX, CHANNELS_MAX = ARRAYS_MAX, NOT_THERE = -1 };

struct imaris {
    const struct array_functions *call; /* of the file */
    void *handle;
    unsigned levels, level, times, channels;
    int *arrays; /* owned: of each time point and channel; NOT_THERE */
    struct array_info info;
};

static bool parse(const char *name, unsigned *level, unsigned *time, unsigned *channel) {
    int end = 0;
    return sscanf(name, "/DataSet/ResolutionLevel %u/TimePoint %u/Channel %u/Data%n", level, time,
                  channel, &end) == 3 &&
           end > 0 && !name[end] && *level < LEVELS_MAX && *time < TIMES_MAX &&
           *channel < CHANNELS_MAX;
}

/* Counts levels, time points and channels. False if there are none. */
static bool count_all(struct imaris *m) {
    struct array_info info;
    unsigned level, time, channel;
    for (unsigned n = 0; m->call->describe(m->handle, n, &info); n++)
        if (parse(info.name, &level, &time, &channel)) {
            m->levels = level >= m->levels ? level + 1 : m->levels;
            m->times = time >= m->times ? time + 1 : m->times;
            m->channels = channel >= m->channels ? channel + 1 : m->channels;
        }
    return m->levels > 0;
}

/* A number that is written as letters. NAN if it is none. */
static double number_in(const struct imaris *m, const char *group, const char *name) {
    char text[64], *end;
    m->call->group_text(m->handle, group, name, text, sizeof text);
    const double value = strtod(text, &end);
    return end > text && isfinite(value) ? value : NAN;
}

/* The arrays are filled up to whole chunks; attributes have the size of the image. */
static void read_size(struct imaris *m, const struct array_info *first) {
    char group[128];
    snprintf(group, sizeof group, "/DataSet/ResolutionLevel %u/TimePoint 0/Channel 0", m->level);
    for (int axis = 0; axis < 3; axis++) {
        const char name[] = { 'I', 'm', 'a', 'g', 'e', 'S', 'i', 'z', 'e', (char)('X' + axis), 0 };
        const double size = number_in(m, group, name);
        const uint64_t most = first->shape[2 - axis];
        m->info.shape[4 - axis] = size >= 1 && size <= (double)most ? (uint64_t)size : most;
        m->info.chunk[4 - axis] = first->chunk[2 - axis];
    }
}

/* Finds the arrays of the level. All have the shape and type of the first one. */
static bool find_arrays(struct imaris *m, const struct arrays *a, struct sp_error *err) {
    struct array_info info, first = { .rank = 0 };
    unsigned level, time, channel;
    for (unsigned n = 0; m->call->describe(m->handle, n, &info); n++)
        if (parse(info.name, &level, &time, &channel) && level == m->level) {
            if (!info.is_number || info.rank != 3)
                return sp_fail(err, SP_ERR_UNSUPPORTED, a->title, "%.80s cannot be read: %.200s",
                               info.name,
                               info.is_number ? "it does not have 3 dimensions" : info.problem);
            first = first.rank ? first : info;
            if (memcmp(info.shape, first.shape, 3 * sizeof info.shape[0]) != 0 ||
                info.number.kind != first.number.kind || info.number.size != first.number.size)
                return sp_fail(err, SP_ERR_UNSUPPORTED, a->title,
                               "%.80s has another size or type than the arrays before it",
                               info.name);
            m->arrays[time * m->channels + channel] = (int)n;
        }
    for (unsigned i = 0; i < m->times * m->channels; i++)
        if (m->arrays[i] == NOT_THERE)
            return sp_fail(err, SP_ERR_FORMAT, a->title,
                           "channel %u of time point %u is missing at level %u; the file may have "
                           "more than %d arrays, the limit",
                           i % m->channels + 1, i / m->channels + 1, m->level, ARRAYS_MAX);
    m->info = (struct array_info){ .rank = 5, .is_number = true, .number = first.number };
    m->info.shape[0] = m->times;
    m->info.shape[1] = m->channels;
    read_size(m, &first);
    for (unsigned d = 0; d < 5; d++)
        snprintf(m->info.dims[d], sizeof m->info.dims[d], "%c", "tczyx"[d]);
    return true;
}

/* The functions of arrays: there is one. */

static void close_image(void *file) {
    struct imaris *m = file;
    m->call->close(m->handle);
    free(m->arrays);
    free(m);
}

static bool describe(void *file, unsigned n, struct array_info *info) {
    const struct imaris *m = file;
    if (n == 0)
        *info = m->info;
    return n == 0;
}

static bool read_box(void *file, unsigned n, const uint64_t *start, const uint64_t *count,
                     void *out, struct sp_error *err) {
    const struct imaris *m = file;
    const size_t bytes =
        (size_t)(count[2] * count[3] * count[4]) * m->info.number.size; /* of one array */
    (void)n;
    for (uint64_t t = start[0]; t < start[0] + count[0]; t++)
        for (uint64_t c = start[1]; c < start[1] + count[1]; c++) {
            const int array = m->arrays[t * m->channels + c];
            if (!m->call->read(m->handle, (unsigned)array, start + 2, count + 2, out, err))
                return false;
            out = (char *)out + bytes;
        }
    return true;
}

static size_t numbers(void *file, unsigned n, const char *name, double *out, size_t most) {
    (void)file;
    (void)n;
    (void)name;
    (void)out;
    (void)most;
    return 0;
}

static void text(void *file, unsigned n, const char *name, char *out, size_t capacity) {
    (void)file;
    (void)n;
    (void)name;
    snprintf(out, capacity, "%s", "");
}

static void channel_name(void *file, unsigned n, uint32_t channel, char *out, size_t capacity) {
    const struct imaris *m = file;
    char group[64];
    (void)n;
    snprintf(group, sizeof group, "/DataSetInfo/Channel %u", channel);
    m->call->group_text(m->handle, group, "Name", out, capacity);
}

static const struct array_functions functions = { .close = close_image,
                                                  .describe = describe,
                                                  .read = read_box,
                                                  .numbers = numbers,
                                                  .text = text,
                                                  .channel = channel_name };

bool imaris_open(struct arrays *a, struct imaris **imaris, struct sp_error *err) {
    struct imaris *m = calloc(1, sizeof *m);
    *imaris = NULL;
    if (!m)
        return sp_fail(err, SP_ERR_MEMORY, a->title, "out of memory");
    m->call = a->call;
    m->handle = a->handle;
    if (!a->call->group_text || strchr(a->file->field, '/') || !count_all(m)) {
        free(m);
        return true;
    }
    m->level = a->file->level < 0 ? 0 : (unsigned)a->file->level;
    const size_t count = (size_t)m->times * m->channels;
    m->arrays = count <= ARRAYS_MAX ? malloc(count * sizeof *m->arrays) : NULL;
    for (size_t i = 0; m->arrays && i < count; i++)
        m->arrays[i] = NOT_THERE;
    bool ok = m->arrays || sp_fail(err, SP_ERR_MEMORY, a->title, "out of memory");
    if (ok && m->level >= m->levels)
        ok = sp_fail(err, SP_ERR_NOT_FOUND, a->title,
                     "there is no level %u; the image has level 0, the finest, to %u", m->level,
                     m->levels - 1);
    if (!ok || !find_arrays(m, a, err)) {
        free(m->arrays);
        free(m);
        return false;
    }
    a->call = &functions;
    a->handle = *imaris = m;
    return true;
}

/* The world. */

/* "2012-03-01 10:20:30.123" in seconds, in any time zone. */
static bool time_of(const struct imaris *m, unsigned point, double *seconds) {
    char name[32], date[64];
    double second = 0;
    struct tm tm = { .tm_mday = 1 };
    snprintf(name, sizeof name, "TimePoint%u", point + 1);
    m->call->group_text(m->handle, "/DataSetInfo/TimeInfo", name, date, sizeof date);
    if (sscanf(date, "%d-%d-%d %d:%d:%lf", &tm.tm_year, &tm.tm_mon, &tm.tm_mday, &tm.tm_hour,
               &tm.tm_min, &second) != 6 ||
        tm.tm_year < 1900 || tm.tm_year > 9999)
        return false;
    tm.tm_year -= 1900;
    tm.tm_mon -= 1;
    *seconds = (double)timegm(&tm) + second;
    return isfinite(second);
}

static bool read_times(const struct imaris *m, struct arrays *a, struct import_header *header,
                       struct sp_error *err) {
    double first;
    if (header->steps.count != m->times || m->times < 2 || !time_of(m, 0, &first))
        return true;
    free(a->times);
    a->times = calloc(m->times, sizeof *a->times);
    if (!a->times)
        return sp_fail(err, SP_ERR_MEMORY, a->title, "out of memory");
    for (unsigned t = 0; t < m->times; t++) {
        if (!time_of(m, t, &a->times[t]) || (t > 0 && a->times[t] - first <= a->times[t - 1]))
            return true; /* the times are unknown */
        a->times[t] -= first;
    }
    header->steps.times = a->times;
    snprintf(header->steps.unit, sizeof header->steps.unit, "s");
    return true;
}

bool imaris_place(const struct imaris *m, struct arrays *a, struct import_header *header,
                  struct sp_error *err) {
    static const char group[] = "/DataSetInfo/Image";
    double least[3], step[3];
    char unit[SP_UNIT_BYTES];
    bool is_known = true;
    for (int axis = 0; axis < 3; axis++) {
        const char low[] = { 'E', 'x', 't', 'M', 'i', 'n', (char)('0' + axis), 0 };
        const char high[] = { 'E', 'x', 't', 'M', 'a', 'x', (char)('0' + axis), 0 };
        least[axis] = number_in(m, group, low);
        step[axis] = (number_in(m, group, high) - least[axis]) / (double)m->info.shape[4 - axis];
        is_known &= step[axis] > 0;
    }
    header->level = m->level;
    header->level_count = m->levels;
    if (!is_known)
        import_warn(a->file->warnings,
                    "The image has no extents (ExtMin0 to ExtMax2); its spacing is unknown.");
    for (int axis = 0; axis < 3 && is_known; axis++) {
        header->grid.spacing[axis] = step[axis];
        header->grid.origin[axis] = least[axis] + step[axis] / 2;
    }
    m->call->group_text(m->handle, group, "Unit", unit, sizeof unit);
    const struct sp_unit *known = sp_unit_find(unit);
    if (is_known)
        snprintf(header->unit, sizeof header->unit, "%s",
                 known   ? known->symbol
                 : *unit ? unit
                         : "um"); /* which Imaris uses */
    return read_times(m, a, header, err);
}
