/* SPDX-License-Identifier: Apache-2.0
 *
 * volume_dump SOURCE OUT [STEP]: loads a file, writes its samples to OUT, and its properties as
 * JSON to standard output. formats_test.py compares both with the output of independent readers.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/volume.h"

static void print_numbers(const char *name, const double *numbers, int count) {
    printf("\"%s\": [", name);
    for (int i = 0; i < count; i++)
        printf("%s%.17g", i ? ", " : "", numbers[i]);
    printf("],\n");
}

static void print_quoted(const char *text) {
    putchar('"');
    for (; *text; text++)
        printf("%s%c", strchr("\"\\", *text) ? "\\" : "", *text);
    putchar('"');
}

static void print_text(const char *name, const char *text) {
    printf("\"%s\": ", name);
    print_quoted(text);
    printf(",\n");
}

static void print_info(const struct sp_volume_info *info) {
    const struct sp_grid *grid = &info->grid;
    printf("{\n");
    print_numbers("spacing", grid->spacing, 3);
    print_numbers("origin", grid->origin, 3);
    print_numbers("direction", grid->direction[0], 9);
    for (int a = 0; a < 3; a++)
        if (grid->coordinates[a]) {
            char name[16];
            snprintf(name, sizeof name, "coordinates%d", a);
            print_numbers(name, grid->coordinates[a], (int)grid->dims[a]);
        }
    print_text("unit", info->unit);
    if (info->vertical.per_unit != 0) {
        print_numbers("z_per_unit", &info->vertical.per_unit, 1);
        print_text("z_unit", info->vertical.unit);
    }
    print_text("value_unit", info->value_unit);
    print_text("anatomy", info->anatomy);
    print_text("name", info->value_name);
    print_text("meaning", sp_meaning_name(info->meaning));
    print_text("vectors", info->vector_bytes == 0 ? ""
                          : info->vector_name[0]  ? info->vector_name
                                                  : "unnamed");
    printf("\"thick\": %s,\n", sp_volume_is_thick_stack(info) ? "true" : "false");
    for (int i = 0; i < SP_OTHER_FIELDS_MAX && info->others[i][0]; i++) {
        char name[16];
        snprintf(name, sizeof name, "other%d", i);
        print_text(name, info->others[i]);
    }
    printf("\"warnings\": [");
    for (int i = 0; i < SP_WARNINGS_MAX && info->warnings[i][0]; i++) {
        printf("%s", i ? ", " : "");
        print_quoted(info->warnings[i]);
    }
    printf("],\n");
    printf("\"steps\": %" PRIu32 ",\n", info->steps.count);
    printf("\"step_shown\": %" PRIu32 ",\n", info->steps.index);
    if (info->steps.times)
        print_numbers("times", info->steps.times, (int)info->steps.count);
    print_text("time_unit", info->steps.unit);
    print_text("type", sp_type_name(info->type));
    printf("\"dims\": [%" PRIu32 ", %" PRIu32 ", %" PRIu32 "]\n}\n", grid->dims[0], grid->dims[1],
           grid->dims[2]);
}

int main(int argc, char **argv) {
    const struct sp_load_options options = { .importer = SPLATD_BIN_DIR "/splat-import",
                                             .step = argc > 3 ? (uint32_t)atoi(argv[3]) : 0,
                                             .has_step = argc > 3 };
    struct sp_error err = { .text = "" };
    if (argc < 3) {
        fprintf(stderr, "usage: volume_dump SOURCE OUT [STEP]\n");
        return 2;
    }
    struct sp_volume *volume = sp_volume_load(argv[1], &options, &err);
    if (!volume) {
        printf("%s: %s: %s\n", sp_code_name(err.code), err.place, err.text);
        return 1;
    }
    const struct sp_volume_info *info = sp_volume_info(volume);
    FILE *out = fopen(argv[2], "wb");
    bool ok =
        out && fwrite(sp_volume_voxels(volume), 1, info->voxel_bytes, out) == info->voxel_bytes;
    ok = out && fclose(out) == 0 && ok;
    print_info(info);
    sp_volume_unref(&volume);
    return ok ? 0 : 2;
}
