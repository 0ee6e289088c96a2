/* SPDX-License-Identifier: Apache-2.0
 *
 * splatctl info: what the daemon would read from a file, without a daemon.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli/commands.h"
#include "cli/print.h"
#include "protocol/volume.h"
#include "sp/series.h"

enum { ROWS = 16, BAR = 40 };

/* Prints the histogram of the finite samples, a row for some bins; bars grow by the logarithm. */
static bool print_histogram(const struct sp_volume_info *info, struct sp_error *err) {
    static const char bar[BAR + 1] = "########################################";
    struct table table = { .columns = 3, .is_right = { true, true } };
    uint64_t counts[ROWS] = { 0 }, most = 1;
    for (int i = 0; i < SP_HISTOGRAM_BINS; i++)
        counts[i * ROWS / SP_HISTOGRAM_BINS] += info->histogram[i];
    for (int i = 0; i < ROWS; i++)
        most = counts[i] > most ? counts[i] : most;
    table_add(&table, "from");
    table_add(&table, "samples");
    table_add(&table, "logarithm");
    for (int i = 0; i < ROWS; i++) {
        const double share = log1p((double)counts[i]) / log1p((double)most);
        table_add(&table, "%.6g", info->data[0] + (info->data[1] - info->data[0]) * i / ROWS);
        table_add(&table, "%" PRIu64, counts[i]);
        table_add(&table, "%.*s", (int)lround(BAR * share), bar);
    }
    return table_print(&table, err);
}

/* The DICOM series of a folder. `list` holds SP_SERIES_MAX. */
static bool list_series(const struct options *options, const char *source, struct sp_series *list,
                        uint32_t *count, struct sp_error *err) {
    const struct sp_load_options how = { .timeout_ms = (int)options->timeout_s * 1000 };
    char path[SP_SOURCE_BYTES];
    struct stat st;
    *count = 0;
    snprintf(path, sizeof path, "%.*s", (int)sp_source_split(source).path_bytes, source);
    return stat(path, &st) != 0 || !S_ISDIR(st.st_mode) ||
           sp_series_list(path, &how, list, count, err);
}

static proto_json *encode_series(const struct sp_series *series) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "uid", series->uid);
    if (series->has_number)
        proto_json_set_integer(&json, "number", series->number);
    proto_json_set_string(&json, "description", series->description);
    proto_json_set_string(&json, "modality", series->modality);
    proto_json_set_integer(&json, "images", series->images);
    proto_json_set_integer(&json, "columns", series->columns);
    proto_json_set_integer(&json, "rows", series->rows);
    proto_json_set_integer(&json, "bytes", (int64_t)series->bytes);
    return json;
}

/* Adds the series of a folder to its description. */
static void add_series(proto_json **json, const struct sp_series *list, uint32_t count) {
    proto_json *all = proto_json_array();
    for (uint32_t i = 0; i < count; i++)
        proto_json_append(&all, encode_series(&list[i]));
    proto_json_set(json, "series", all);
}

static bool print_series(const struct sp_series *list, uint32_t count, struct sp_error *err) {
    static const char *const titles[] = { "series", "modality", "images",     "size",
                                          "bytes",  "uid",      "description" };
    struct table table = { .columns = sizeof titles / sizeof *titles,
                           .is_right = { true, false, true, true, true } };
    for (size_t i = 0; i < sizeof titles / sizeof *titles; i++)
        table_add(&table, "%s", titles[i]);
    for (uint32_t i = 0; i < count; i++) {
        const struct sp_series *s = &list[i];
        if (s->has_number)
            table_add(&table, "%" PRId32, s->number);
        else
            table_add(&table, "-");
        table_add(&table, "%s", s->modality);
        table_add(&table, "%" PRIu32, s->images);
        table_add(&table, "%" PRIu32 " x %" PRIu32, s->columns, s->rows);
        table_add(&table, "%" PRIu64, s->bytes);
        table_add(&table, "%s", s->uid);
        table_add(&table, "%s", s->description);
    }
    return table_print(&table, err);
}

/* Prints what is known of the volume; `json` is its description. */
static bool print_info(const struct options *options, const struct sp_volume_info *info,
                       proto_json **json, struct sp_error *err) {
    struct sp_series *list = calloc(SP_SERIES_MAX, sizeof *list);
    uint32_t count = 0;
    bool ok = list || sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the series");
    ok = ok && list_series(options, options->argument, list, &count, err);
    if (ok && count > 0 && options->json)
        add_series(json, list, count);
    ok = ok && print_json(options, *json, err);
    if (ok && !options->json && info->elements.kind == SP_KIND_GRID)
        ok = print_histogram(info, err);
    if (ok && !options->json && count > 0)
        ok = print_series(list, count, err);
    free(list);
    return ok;
}

int command_info(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("info", "needs a source: a file, demo:NAME or an address");
    struct sp_volume *volume = load_local(options, options->argument, err);
    if (!volume)
        return 1;
    const struct sp_volume_info *info = sp_volume_info(volume);
    proto_json *json = proto_volume_encode(info, info->name, options->json);
    const bool ok = json ? print_info(options, info, &json, err)
                         : sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the description");
    proto_json_free(&json);
    sp_volume_unref(&volume);
    return ok ? 0 : 1;
}
