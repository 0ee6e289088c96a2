/* SPDX-License-Identifier: Apache-2.0
 *
 * Renders CT scans from SPLATD_DATA_DIR at 256² px, loaded in the same way as in the daemon. It
 * uses their default views and the views of the folder `bench/scenes` beside that folder, if it
 * exists. The integral would take too long for volumes of this size. Instead, each image must not
 * be empty, must be the same each time, and its mean and variance must be within recorded bands.
 * SPLATD_TEST_DUMP=FOLDER writes the images to that folder.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "protocol/json.h"
#include "protocol/view.h"
#include "support/data.h"
#include "support/render.h"

enum { SIDE = 256 };

/* Mean and variance of (R+G+B)/3 over the opaque background, recorded with the scalar CPU backend.
 * A band is [record / factor, record · factor]. The factor is 1.03 for the views of scene files and
 * 1.3 for default views, because the default transfer function may be improved. */
struct band {
    const char *file, *scene; /* scene: NULL = the default view */
    unsigned camera;
    double mean, variance;
};

static const struct band bands[] = {
    { "engine_256x256x128_uint8.nrrd", NULL, 0, 0.11128, 0.053474 },
    { "bonsai_256x256x256_uint8.nrrd", NULL, 0, 0.11770, 0.063607 },
    { "lobster_301x324x56_uint8.nrrd", NULL, 0, 0.01694, 0.007707 },
    { "aneurism_256x256x256_uint8.nrrd", NULL, 0, 0.04056, 0.021278 },
    { "cthead_256x256x113_uint16.nrrd", NULL, 0, 0.10802, 0.052987 },
    { "engine_256x256x128_uint8.nrrd", "engine", 0, 0.14917, 0.069695 },
    { "engine_256x256x128_uint8.nrrd", "engine", 9, 0.14403, 0.067114 },
    { "bonsai_256x256x256_uint8.nrrd", "bonsai", 3, 0.06258, 0.025655 },
    { "bonsai_256x256x256_uint8.nrrd", "bonsai-full", 3, 0.19232, 0.068252 },
    { "lobster_301x324x56_uint8.nrrd", "lobster", 6, 0.04157, 0.022381 },
    { "aneurism_256x256x256_uint8.nrrd", "aneurism", 12, 0.07744, 0.044032 },
    { "cthead_256x256x113_uint16.nrrd", "head", 1, 0.20730, 0.103324 },
    { "cthead_256x256x113_uint16.nrrd", "head-full", 17, 0.28484, 0.100944 },
};

struct run {
    struct sp_renderer *renderer, *other; /* with 2 threads; with 3 threads */
    struct sp_frame_pool *pool;
    unsigned rendered, skipped, failed;
};

/* Prints a failure. Returns false. */
static bool report_failure(const char *name, const struct sp_error *err) {
    printf("FAILED %s: %s: %s\n", name, err->place, err->text);
    return false;
}

/* Returns the content of a file; NULL if it cannot be read. */
static char *read_file(const char *path, size_t *size) {
    enum { LIMIT = 1 << 20 };
    FILE *file = fopen(path, "rb");
    char *bytes = file ? malloc(LIMIT) : NULL;
    *size = bytes ? fread(bytes, 1, LIMIT, file) : 0;
    if (file)
        fclose(file);
    return bytes;
}

/* Applies the view and the camera of a scene file to *view. Sets *visible to the number of visible
 * voxels in the file. Returns 1 on success, 0 if the file does not exist, -1 on failure. */
static int apply_scene(const struct band *band, struct sp_view *view, int64_t *visible) {
    char path[1024];
    struct sp_error err = { 0 };
    size_t size;
    snprintf(path, sizeof path, "%s/../bench/scenes/%s.json", test_data_folder(SPLATD_DATA_DIR),
             band->scene);
    if (access(path, R_OK)) {
        printf("skipped: the scene %s does not exist\n", path);
        return 0;
    }
    char *bytes = read_file(path, &size);
    proto_json *json = bytes ? proto_json_parse(bytes, size, &err) : NULL;
    proto_json *patch = proto_json_object();
    const proto_json *camera = proto_json_at(proto_json_get(json, "cameras"), band->camera);
    const struct sp_view defaults = *view;
    proto_json_set(&patch, "camera", proto_json_ref((proto_json *)camera));
    bool ok = json && patch &&
              proto_view_apply(proto_json_get(json, "view"), &defaults, view, &err) &&
              proto_view_apply(patch, &defaults, view, &err) &&
              proto_json_integer(proto_json_get(json, "visible_voxels"), visible);
    if (!ok)
        report_failure(path, &err);
    proto_json_free(&patch);
    proto_json_free(&json);
    free(bytes);
    return ok ? 1 : -1;
}

static bool in_band(const char *what, double got, double recorded, double factor) {
    bool ok = got >= recorded / factor && got <= recorded * factor;
    if (!ok)
        printf("  the %s is %.5g; expected %.5g up to a factor of %.2f\n", what, got, recorded,
               factor);
    return ok;
}

/* True if the image is opaque, within its bands, and neither nearly black nor partly saturated. */
static bool check_image(const struct band *band, const struct test_image *image) {
    size_t count = (size_t)image->width * image->height, lit = 0, white = 0;
    double sum = 0, squares = 0;
    for (size_t i = 0; i < count; i++) {
        const double *p = image->rgba + i * 4;
        double v = (p[0] + p[1] + p[2]) / 3;
        if (!isfinite(v) || p[3] < 0.999 || p[3] > 1.001) {
            printf("  pixel %zu is not finite or not opaque: %g %g %g %g\n", i, p[0], p[1], p[2],
                   p[3]);
            return false;
        }
        lit += v > 0.02;
        white += p[0] > 0.995 && p[1] > 0.995 && p[2] > 0.995;
        sum += v;
        squares += v * v;
    }
    double mean = sum / (double)count, variance = squares / (double)count - mean * mean;
    double part = (double)lit / (double)count, over = (double)white / (double)count;
    printf("  mean %.5f, variance %.6f; %.1f %% of the pixels are not black (more than 3 %% "
           "expected), %.2f %% are white (less than 2 %% expected)\n",
           mean, variance, 100 * part, 100 * over);
    double factor = band->scene ? 1.03 : 1.3;
    bool bright = in_band("mean", mean, band->mean, factor);
    bool varied = in_band("variance", variance, band->variance, factor);
    return bright && varied && part > 0.03 && over < 0.02;
}

static bool render_one(struct run *run, const struct band *band, const char *name,
                       struct sp_volume *volume, const struct sp_view *view, int64_t visible) {
    struct sp_render_options floats = { .format = SP_RGBAF32 };
    struct sp_frame *frames[3] = { 0 };
    struct test_image image;
    struct sp_error err;
    for (int i = 0; i < 3; i++) {
        frames[i] = sp_renderer_render(i < 2 ? run->renderer : run->other, volume, view, run->pool,
                                       &floats, &err);
        if (!frames[i])
            return report_failure(name, &err);
    }
    const struct sp_frame_stats *stats = &frames[0]->stats;
    printf("%s: %llu visible voxels, %llu splats, %.0f ms\n", name,
           (unsigned long long)stats->visible_voxels, (unsigned long long)stats->splats,
           stats->render_ms);
    bool ok = true;
    if (visible >= 0 && llabs((long long)stats->visible_voxels - visible) > visible / 1000) {
        printf("  the scene file says %lld visible voxels; the renderer counts %llu\n",
               (long long)visible, (unsigned long long)stats->visible_voxels);
        ok = false;
    }
    for (int i = 1; i < 3; i++)
        if (!test_frames_equal(frames[0], frames[i])) {
            printf("  frame %d differs from the first\n", i);
            ok = false;
        }
    if (!test_image_from_frame(&image, frames[0]))
        return false;
    ok &= check_image(band, &image);
    const char *dump = getenv("SPLATD_TEST_DUMP");
    char path[1024];
    snprintf(path, sizeof path, "%s/real-%s.png", dump ? dump : ".", name);
    if ((dump || !ok) && test_image_write_png(&image, path))
        printf("  %s\n", path);
    test_image_finish(&image);
    for (int i = 0; i < 3; i++)
        sp_frame_unref(&frames[i]);
    return ok;
}

static void run_band(struct run *run, const struct band *band) {
    char path[1024], name[256];
    struct sp_load_options load = { .importer = SPLATD_BIN_DIR "/splat-import" };
    struct sp_error err;
    struct sp_view view;
    int64_t visible = -1;
    snprintf(name, sizeof name, "%.*s-%s-%u", (int)strcspn(band->file, "_"), band->file,
             band->scene ? band->scene : "default", band->camera);
    if (!test_data_path(SPLATD_DATA_DIR, band->file, path, sizeof path)) {
        run->skipped++;
        return;
    }
    struct sp_volume *volume = sp_volume_load(path, &load, &err);
    if (!volume) {
        run->failed += !report_failure(path, &err);
        return;
    }
    sp_view_init(&view, sp_volume_info(volume), "real");
    view.transfer_function.order = SP_TF_PRE;
    int scene = band->scene ? apply_scene(band, &view, &visible) : 1;
    view.size[0] = view.size[1] = SIDE;
    if (scene > 0) {
        bool ok = render_one(run, band, name, volume, &view, visible);
        if (!ok)
            printf("FAILED %s\n", name);
        run->rendered++;
        run->failed += !ok;
    } else if (scene < 0) {
        run->failed++;
    } else {
        run->skipped++;
    }
    sp_renderer_evict(run->renderer, volume);
    sp_renderer_evict(run->other, volume);
    sp_volume_unref(&volume);
    fflush(stdout);
}

int main(void) {
    struct run run = { 0 };
    struct sp_error err;
    struct sp_renderer_options options = { .backend = "cpu", .threads = 2 };
    run.renderer = sp_renderer_create(&options, &err);
    options.threads = 3;
    run.other = run.renderer ? sp_renderer_create(&options, &err) : NULL;
    run.pool = run.other ? sp_frame_pool_create((size_t)64 << 20, &err) : NULL;
    if (!run.pool) {
        report_failure("cannot create a renderer or its frame pool", &err);
        return EXIT_FAILURE;
    }
    for (size_t i = 0; i < sizeof bands / sizeof *bands; i++)
        run_band(&run, &bands[i]);
    sp_renderer_destroy(&run.renderer);
    sp_renderer_destroy(&run.other);
    sp_frame_pool_destroy(&run.pool);
    printf("%u rendered, %u failed, %u skipped\n", run.rendered, run.failed, run.skipped);
    return run.failed ? EXIT_FAILURE : run.rendered ? EXIT_SUCCESS : TEST_SKIPPED;
}
