/* SPDX-License-Identifier: Apache-2.0
 *
 * splatctl info: what the daemon would read from a file, without a daemon.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/print.h"
#include "protocol/volume.h"

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

int command_info(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("info", "needs a source: a file, demo:NAME or an address");
    struct sp_volume *volume = load_local(options, options->argument, err);
    if (!volume)
        return 1;
    const struct sp_volume_info *info = sp_volume_info(volume);
    proto_json *json = proto_volume_encode(info, info->name, options->json);
    bool ok = json ? print_json(options, json, err)
                   : sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the description");
    if (ok && !options->json && info->elements.kind == SP_KIND_GRID)
        ok = print_histogram(info, err);
    proto_json_free(&json);
    sp_volume_unref(&volume);
    return ok ? 0 : 1;
}
