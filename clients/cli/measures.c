/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists the measurements of a session, or exports them as CSV.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/output.h"
#include "cli/print.h"

/* Adds a number, or "-" if there is none. */
static void add_number(struct table *table, const proto_json *object, const char *key) {
    double value;
    if (proto_json_number(proto_json_get(object, key), &value))
        table_add(table, "%.6g", value);
    else
        table_add(table, "-");
}

/* Adds the lengths, areas and counts that a part or a path has besides its value. */
static void add_more(struct table *table, const proto_json *measure) {
    const char *unit = text_of(measure, "unit");
    const int unit_bytes = (int)strcspn(unit, "^");
    double number;
    int64_t samples;
    if (proto_json_number(proto_json_get(measure, "area"), &number) &&
        proto_json_integer(proto_json_get(measure, "samples"), &samples))
        table_add(table, "area %.6g%s%.*s%s, %" PRId64 " samples", number, unit_bytes ? " " : "",
                  unit_bytes, unit, unit_bytes ? "^2" : "", samples);
    else if (proto_json_number(proto_json_get(measure, "straight"), &number))
        table_add(table, "straight %.6g%s%s", number, unit[0] ? " " : "", unit);
    else
        table_add(table, "-");
}

static void add_measure(struct table *table, const proto_json *measure) {
    const proto_json *statistics = proto_json_get(measure, "statistics");
    const char *text = text_of(measure, "text"), *data_unit = text_of(measure, "data_unit");
    table_add(table, "%s", text_of(measure, "id"));
    table_add(table, "%s", text_of(measure, "kind"));
    table_add(table, "%s", text[0] ? text : "-");
    add_number(table, measure, "value");
    table_add(table, "%s", text_of(measure, "unit")[0] ? text_of(measure, "unit") : "-");
    add_number(table, statistics, "mean");
    add_number(table, statistics, "deviation");
    table_add(table, "%s", statistics && data_unit[0] ? data_unit : "-");
    add_more(table, measure);
    table_add(table, "%s", text_of(measure, "note"));
}

static const struct listing measures = { "measures",
                                         { "ID", "KIND", "TEXT", "VALUE", "UNIT", "MEAN", "SD",
                                           "DATA UNIT", "MORE", "NOTE" },
                                         10,
                                         1 << 3 | 1 << 5 | 1 << 6,
                                         add_measure };

/* Writes the daemon's CSV unchanged. */
static bool write_csv(const struct options *options, struct http *http, const char *path,
                      struct sp_error *err) {
    struct http_response response = { 0 };
    bool ok = http_request(http, "GET", path, "text/csv", NULL, &response, err) &&
              output_write(options->out ? options->out : "-", response.body, response.size, err);
    http_response_finish(&response);
    return ok;
}

static bool list_measures(const struct options *options, struct http *http, bool is_csv,
                          struct sp_error *err) {
    char *session = collection_path(http, "sessions", options->argument, err), *path = NULL;
    bool ok = session != NULL;
    if (ok && asprintf(&path, "%s/measures%s", session, is_csv ? "?format=csv" : "") < 0) {
        path = NULL;
        ok = sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    }
    if (ok && is_csv) {
        ok = write_csv(options, http, path, err);
    } else if (ok) {
        proto_json *answer = http_json(http, "GET", path, NULL, err);
        ok = answer &&
             (options->json ? print_json(options, answer, err)
                            : print_list(&measures, proto_json_get(answer, "measures"), err));
        proto_json_free(&answer);
    }
    free(path);
    free(session);
    return ok;
}

int command_measures(const struct options *options, struct sp_error *err) {
    const bool is_csv = options->format && strcmp(options->format, "csv") == 0;
    if (!options->argument)
        return usage_error("measures",
                           "give the id of a session; \"splatctl sessions\" lists the ids");
    if (options->format && !is_csv)
        return usage_error("--format", "\"%s\" is not csv", options->format);
    if (options->out && !is_csv)
        return usage_error("--out", "needs --format csv");
    if (is_csv && options->json)
        return usage_error("measures", "takes either --json or --format csv");
    struct http *http = connect_to_daemon(options, err);
    bool ok = http && list_measures(options, http, is_csv, err);
    http_destroy(&http);
    return ok ? 0 : 1;
}
