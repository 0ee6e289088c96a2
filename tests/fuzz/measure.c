/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → JSON → measurement → value → JSON and CSV. Every accepted measurement is computed, and is
 * the same after it was saved and restored; every refused one names the place.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/measure.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool ok) {
    if (!ok)
        abort();
}

static struct sp_volume *volume(void) {
    static struct sp_volume *made;
    static const double uneven[5] = { 0, 1, 1.5, 4, 5 };
    struct sp_grid grid = { .dims = { 6, 5, 4 },
                            .spacing = { 1, 1.25, 3 },
                            .direction = { { 0.8, -0.6, 0 }, { 0.6, 0.8, 0 }, { 0, 0, 1 } },
                            .coordinates = { NULL, uneven, NULL } };
    float voxels[120];
    struct sp_error err;
    for (int i = 0; i < 120; i++)
        voxels[i] = i == 50 ? 0.0f / 0.0f : (float)i;
    if (!made)
        made = sp_volume_create(&grid, SP_FLOAT32, voxels, "v", &err);
    return made;
}

static char *text_of(const struct proto_measure *measure) {
    proto_json *json = proto_measure_encode(measure);
    char *text = proto_json_to_text(json, NULL);
    proto_json_free(&json);
    return text;
}

static void check_saved(const struct proto_measure *measure) {
    struct proto_measure again;
    struct sp_error err;
    size_t size;
    char *text = text_of(measure), *csv = proto_measures_to_csv(measure, 1, &size);
    proto_json *json = proto_json_parse(text, strlen(text), &err);
    require(proto_measure_restore(json, &again));
    char *second = text_of(&again);
    require(strcmp(text, second) == 0);
    require(size > 2 && memcmp(csv + size - 2, "\r\n", 2) == 0);
    proto_json_free(&json);
    free(second);
    free(text);
    free(csv);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct sp_error err = { .code = SP_OK };
    struct proto_measure measure = { .id = "m", .volume = "v", .color = "#000000", .author = "a" };
    proto_json *json = proto_json_parse((const char *)data, size, &err);
    if (!json)
        return 0;
    struct proto_measure restored;
    if (proto_measure_restore(json, &restored))
        check_saved(&restored);
    if (!proto_measure_apply(json, true, &measure, &err)) {
        require(err.code == SP_ERR_INVALID && err.place[0] == '/' && err.text[0]);
    } else if (sp_measure_cost(volume(), &measure.geometry) > 10000) {
        ; /* takes time and tests nothing more */
    } else if (sp_measure_compute(volume(), &measure.geometry, &measure.value.result, &err)) {
        check_saved(&measure);
    } else {
        require(err.code == SP_ERR_INVALID && err.place[0] == '/');
    }
    proto_json_free(&json);
    return 0;
}
