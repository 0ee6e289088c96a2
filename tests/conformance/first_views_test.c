/* SPDX-License-Identifier: Apache-2.0
 *
 * Renders the first views of the built-in volumes and of real volumes, and measures what a person
 * sees: how much of the image the object fills, that the surroundings are dark, that the object
 * stands out from them, and that it is not burnt out. The second table holds what is known about
 * single volumes: which way is up, and from where the camera looks. Prints a line per volume.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "sp/renderer.h"
#include "support/data.h"

enum { SIDE = 256 };

struct measures {
    double fill;     /* of the longer side of the box around the object, as a share of the image */
    double offset;   /* of the middle of that box from the middle of the image, same unit */
    double border;   /* mean brightness of the outermost 3 % of the image, [0, 1] */
    double contrast; /* mean brightness of the object minus `border` */
    double burnt;    /* share of the object that is nearly white */
};

struct expected {
    const char *name; /* a built-in volume, or a file of the data folder */
    double up[3];     /* {0, 0, 0} = any */
    double away[3];   /* the camera looks from this side; {0, 0, 0} = any */
};

static const struct expected volumes[] = {
    { "demo:phantom", { 0, 0, 1 }, { 0, -1, 0 } },
    { "demo:engine", { 0, 0, 1 }, { 0, -1, 0 } },
    { "demo:vessels", { 0, 0, 1 }, { 0, -1, 0 } },
    { "demo:marschner-lobb", { 0, 0, 1 }, { 0, 0, 0 } },
    { "demo:hydrogen", { 0, 0, 1 }, { 0, 0, 0 } },
    { "demo:galaxy", { 0, 0, 0 }, { 0, 0, 1 } }, /* flat: from above */
    { "demo:checkerboard", { 0, 0, 0 }, { 0, 0, 1 } },
    { "demo:sparse", { 0, 0, 1 }, { 0, 0, 0 } },
    { "demo:turbulence", { 0, 0, 1 }, { 0, 0, 0 } },
    { "demo:noise", { 0, 0, 1 }, { 0, 0, 0 } },
    { "demo:tornado", { 0, 0, 1 }, { 0, -1, 0 } },
    { "demo:jet", { 0, 0, 0 }, { 0, 0, 1 } }, /* flat: from above */
    { "aneurism_256x256x256_uint8.nrrd", { 0, 0, 0 }, { 0, 0, 0 } },
    { "bonsai_256x256x256_uint8.nrrd", { 0, 1, 0 }, { 0, 0, 0 } },    /* the pot is below */
    { "cthead_256x256x113_uint16.nrrd", { 0, 0, -1 }, { 0, -1, 0 } }, /* the face */
    { "engine_256x256x128_uint8.nrrd", { 0, 0, 0 }, { 0, 0, 0 } },
    { "fuel_64x64x64_uint8.nrrd", { 0, 0, 0 }, { 0, -1, 0 } },
    { "headsq_64x64x93_int16.nrrd", { 0, 0, -1 }, { 0, 0, 0 } },
    { "hydrogen_atom_128x128x128_uint8.nrrd", { 0, 0, 0 }, { 0, 0, 0 } },
    { "lobster_301x324x56_uint8.nrrd", { 0, -1, 0 }, { 0, 0, -1 } }, /* flat */
    { "nucleon_41x41x41_uint8.nrrd", { 0, 0, 0 }, { 0, 0, 0 } },
    { "../lossy/foot_256x256x256_uint8_LOSSY.nrrd", { 0, 1, 0 }, { 0, 0, 0 } },
    { "../formats/vti/isabel_02.vti", { 0, 1, 0 }, { 0, 0, 1 } }, /* a map */
    { "../formats/vtk/carotid.vtk", { 0, 0, 0 }, { 0, 0, 0 } },
    { "../formats/nrrd/stent_gzip_float.nrrd", { 0, 0, 1 }, { 0, 0, 0 } },
    { "../formats/tiff/flybrain.tif", { 0, -1, 0 }, { 0, 0, -1 } },
};

static double brightness(const struct sp_frame *frame, uint32_t x, uint32_t y) {
    const uint8_t *p = (const uint8_t *)frame->pixels + y * frame->stride_bytes + 4 * (size_t)x;
    return (p[0] + p[1] + p[2]) / 765.0;
}

/* The box of all but 0.5 % of the object's pixels on each side. */
static void measure_box(const uint32_t rows[SIDE], const uint32_t columns[SIDE], uint32_t total,
                        struct measures *m) {
    const uint32_t *const counts[2] = { columns, rows };
    for (int a = 0; a < 2; a++) {
        uint32_t low = 0, high = SIDE - 1, sum = 0;
        while (low < SIDE - 1 && (sum += counts[a][low]) * 200 <= total)
            low++;
        for (sum = 0; high > low && (sum += counts[a][high]) * 200 <= total;)
            high--;
        m->fill = fmax(m->fill, (high + 1.0 - low) / SIDE);
        m->offset = fmax(m->offset, fabs((high + 1.0 + low) / 2 - SIDE / 2.0) / SIDE);
    }
}

static struct measures measure(const struct sp_frame *frame) {
    struct measures m = { 0 };
    uint32_t rows[SIDE] = { 0 }, columns[SIDE] = { 0 }, object = 0, outside = 0, burnt = 0;
    double object_sum = 0, outside_sum = 0;
    const uint32_t edge = SIDE * 3 / 100;
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++) {
            double v = brightness(frame, x, y);
            if (x < edge || y < edge || x >= SIDE - edge || y >= SIDE - edge) {
                outside++;
                outside_sum += v;
            }
            if (v < 0.06)
                continue;
            object++;
            object_sum += v;
            burnt += v > 0.97;
            rows[y]++;
            columns[x]++;
        }
    m.border = outside_sum / outside;
    if (object > 0) {
        measure_box(rows, columns, object, &m);
        m.contrast = object_sum / object - m.border;
        m.burnt = (double)burnt / object;
    }
    return m;
}

static bool is_along(const double wanted[3], struct sp_vec3 v, double least) {
    struct sp_vec3 w = sp_vec3_from(wanted);
    return sp_vec3_length(w) == 0 || sp_vec3_dot(w, v) >= least;
}

static bool check(const struct expected *e, const struct sp_view *view,
                  const struct sp_frame *frame) {
    struct measures m = measure(frame);
    struct sp_vec3 away = sp_vec3_normalize(
        sp_vec3_sub(sp_vec3_from(view->camera.position), sp_vec3_from(view->camera.target)));
    bool is_framed = m.fill >= 0.6 && m.fill <= 0.92 && m.offset <= 0.1;
    bool is_clear = m.border <= 0.02 && m.contrast >= 0.12 && m.burnt <= 0.05;
    bool is_oriented =
        is_along(e->up, sp_vec3_from(view->camera.up), 0.999) && is_along(e->away, away, 0.6);
    const char *base = strrchr(e->name, '/');
    printf("%-40s %6.2f %6.2f %8.3f %8.2f %6.3f%s%s%s\n", base ? base + 1 : e->name, m.fill,
           m.offset, m.border, m.contrast, m.burnt, is_framed ? "" : "  FAILED framing",
           is_clear ? "" : "  FAILED contrast", is_oriented ? "" : "  FAILED orientation");
    return is_framed && is_clear && is_oriented;
}

/* Returns 1 if the view is good, 0 if not, -1 if the file does not exist. */
static int run(struct sp_renderer *renderer, struct sp_frame_pool *pool, const struct expected *e) {
    char path[1024];
    const struct sp_load_options load = { .importer = SPLATD_BIN_DIR "/splat-import" };
    const struct sp_render_options options = { .format = SP_RGBA8 };
    struct sp_error err;
    struct sp_view view;
    bool is_file = strncmp(e->name, "demo:", 5) != 0;
    if (is_file && !test_data_path(SPLATD_DATA_DIR, e->name, path, sizeof path))
        return -1;
    struct sp_volume *volume = sp_volume_load(is_file ? path : e->name, &load, &err);
    struct sp_frame *frame = NULL;
    if (volume) {
        sp_view_choose(&view, volume, "first");
        view.size[0] = view.size[1] = SIDE;
        frame = sp_renderer_render(renderer, volume, &view, pool, &options, &err);
        sp_renderer_evict(renderer, volume);
    }
    if (!frame)
        printf("FAILED %s: %s: %s\n", e->name, err.place, err.text);
    int good = frame && check(e, &view, frame);
    sp_frame_unref(&frame);
    if (volume)
        sp_volume_unref(&volume);
    return good;
}

int main(void) {
    struct sp_error err;
    const struct sp_renderer_options options = { .backend = "cpu", .threads = 2 };
    struct sp_renderer *renderer = sp_renderer_create(&options, &err);
    struct sp_frame_pool *pool = renderer ? sp_frame_pool_create((size_t)16 << 20, &err) : NULL;
    if (!pool) {
        printf("FAILED: %s: %s\n", err.place, err.text);
        return EXIT_FAILURE;
    }
    unsigned good = 0, bad = 0, skipped = 0;
    printf("%-40s %6s %6s %8s %8s %6s\n", "volume", "fill", "offset", "border", "contrast",
           "burnt");
    for (size_t i = 0; i < sizeof volumes / sizeof volumes[0]; i++) {
        int result = run(renderer, pool, &volumes[i]);
        good += result > 0;
        bad += result == 0;
        skipped += result < 0;
        fflush(stdout);
    }
    sp_frame_pool_destroy(&pool);
    sp_renderer_destroy(&renderer);
    printf("%u good, %u bad, %u skipped\n", good, bad, skipped);
    if (bad > 0)
        return EXIT_FAILURE;
    return skipped > 0 ? TEST_SKIPPED : EXIT_SUCCESS;
}
