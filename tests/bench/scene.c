/* SPDX-License-Identifier: Apache-2.0 */
#include "bench/scene.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "protocol/json.h"
#include "protocol/limits.h"
#include "protocol/view.h"

enum { ORBIT_VIEWS = 24, DEPTH_MAX = 8 };

struct bench_volumes {
    unsigned count;
    struct {
        char id[SP_NAME_BYTES];
        struct sp_volume *volume;
    } list[SP_LAYERS_MAX];
};

static proto_json *read_json(const char *path, struct sp_error *err) {
    FILE *file = fopen(path, "rb");
    char *bytes = malloc(PROTO_BODY_MAX + 1);
    proto_json *json = NULL;
    if (!file || !bytes) {
        sp_fail(err, file ? SP_ERR_MEMORY : SP_ERR_IO, path, "%s", strerror(errno));
    } else {
        size_t size = fread(bytes, 1, PROTO_BODY_MAX + 1, file);
        json = proto_json_parse(bytes, size, err);
    }
    if (file)
        fclose(file);
    free(bytes);
    return json;
}

/* Searches `folder` recursively for a file of that name; false if there is none. */
static bool find_file(const char *folder, const char *name, int depth, char *path, size_t size) {
    DIR *dir = opendir(folder);
    bool found = false;
    if (!dir)
        return false;
    for (struct dirent *entry; !found && (entry = readdir(dir));) {
        char *sub = NULL;
        struct stat st;
        if (entry->d_name[0] == '.' || asprintf(&sub, "%s/%s", folder, entry->d_name) < 0)
            continue;
        if (stat(sub, &st) == 0) {
            if (S_ISDIR(st.st_mode) && depth < DEPTH_MAX)
                found = find_file(sub, name, depth + 1, path, size);
            else if (S_ISREG(st.st_mode) && strcmp(entry->d_name, name) == 0)
                found = snprintf(path, size, "%s", sub) < (int)size;
        }
        free(sub);
    }
    closedir(dir);
    return found;
}

/* Finds "demo:NAME", a path, or a file name below the data folder. */
static bool find_source(const char *source, const char *data, char *path, size_t size) {
    struct stat st;
    if (strncmp(source, "demo:", 5) != 0 && (!strchr(source, '/') || stat(source, &st) != 0))
        return data && find_file(data, source, 0, path, size);
    return snprintf(path, size, "%s", source) < (int)size;
}

static bool load_volume(struct bench_scene *scene, const char *source, struct sp_error *err) {
    char path[4096];
    if (!find_source(source, scene->data, path, sizeof path)) {
        snprintf(scene->skipped, sizeof scene->skipped, "no %s below %s", source,
                 scene->data ? scene->data : "a folder named by --data");
        return true;
    }
    scene->volume = sp_volume_load(path, NULL, err);
    return scene->volume != NULL;
}

struct sp_volume *bench_scene_find(void *user, const char *id) {
    const struct bench_scene *scene = user;
    struct bench_volumes *volumes = scene->volumes;
    struct sp_error err = { .text = "not below the folder of --data" };
    char path[4096];
    for (unsigned i = 0; i < volumes->count; i++)
        if (strcmp(volumes->list[i].id, id) == 0)
            return sp_volume_ref(volumes->list[i].volume);
    struct sp_volume *volume = NULL;
    if (volumes->count < SP_LAYERS_MAX && find_source(id, scene->data, path, sizeof path))
        volume = sp_volume_load(path, NULL, &err);
    if (!volume) {
        fprintf(stderr, "splat-bench: %s: %s\n", id, err.text);
        return NULL;
    }
    snprintf(volumes->list[volumes->count].id, SP_NAME_BYTES, "%s", id);
    volumes->list[volumes->count++].volume = volume;
    return sp_volume_ref(volume);
}

static bool apply_text(struct sp_view *view, const char *text, struct sp_error *err) {
    proto_json *patch = proto_json_parse(text, strlen(text), err);
    bool ok = patch && proto_view_apply(patch, view, view, err);
    proto_json_free(&patch);
    return ok;
}

static bool override_layers(struct sp_view *view, const char *layers, struct sp_error *err) {
    char *text = NULL;
    int length = layers[0] == '[' ? asprintf(&text, "{\"layers\": %s}", layers)
                                  : asprintf(&text, "{\"layers\": [{\"type\": \"%s\"}]}", layers);
    bool ok = length >= 0 ? apply_text(view, text, err)
                          : sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the layers");
    if (length >= 0)
        free(text);
    return ok;
}

bool bench_view_override(struct sp_view *view, const struct bench_overrides *o,
                         struct sp_error *err) {
    const char *const fields[][3] = { { "filter", "mode", o->mode },
                                      { "compositing", "mode", o->compositing },
                                      { "transfer_function", "order", o->order },
                                      { "shading", "mode", o->shading },
                                      { "quality", "level_of_detail", o->lod } };
    char text[256];
    for (size_t i = 0; i < sizeof fields / sizeof fields[0]; i++) {
        if (!fields[i][2])
            continue;
        snprintf(text, sizeof text, "{\"%s\": {\"%s\": \"%.64s\"}}", fields[i][0], fields[i][1],
                 fields[i][2]);
        if (!apply_text(view, text, err))
            return false;
    }
    if (o->layers && !override_layers(view, o->layers, err))
        return false;
    if (o->size) {
        snprintf(text, sizeof text, "{\"size\": [%u, %u]}", o->size, o->size);
        return apply_text(view, text, err);
    }
    return true;
}

/* Rotates the eye around the target about `up`, one full turn in `count` equal steps. */
static void make_orbit(struct bench_scene *scene) {
    const struct sp_camera *c = &scene->view.camera;
    double up[3], length = sqrt(c->up[0] * c->up[0] + c->up[1] * c->up[1] + c->up[2] * c->up[2]);
    double away[3], along = 0;
    for (int i = 0; i < 3; i++) {
        up[i] = c->up[i] / length;
        away[i] = c->position[i] - c->target[i];
        along += away[i] * up[i];
    }
    for (unsigned k = 0; k < scene->camera_count; k++) {
        double angle = 2 * M_PI * k / scene->camera_count;
        struct sp_camera *to = &scene->cameras[k];
        *to = *c;
        for (int i = 0; i < 3; i++) { /* Rodrigues' formula */
            int j = (i + 1) % 3, l = (i + 2) % 3;
            double across = up[j] * away[l] - up[l] * away[j];
            to->position[i] = c->target[i] + cos(angle) * away[i] + sin(angle) * across +
                              (1 - cos(angle)) * along * up[i];
        }
    }
}

/* Applies each patch to the scene's view and takes the camera. */
static bool read_cameras(struct bench_scene *scene, const proto_json *list, struct sp_error *err) {
    for (unsigned k = 0; k < scene->camera_count; k++) {
        struct sp_view view = scene->view;
        proto_json *camera = proto_json_ref((proto_json *)(uintptr_t)proto_json_at(list, k));
        proto_json *patch = proto_json_object();
        proto_json_set(&patch, "camera", camera);
        bool ok = proto_view_apply(patch, &scene->view, &view, err);
        proto_json_free(&patch);
        if (!ok)
            return false;
        scene->cameras[k] = view.camera;
    }
    return true;
}

static bool fill_scene(struct bench_scene *scene, const proto_json *json,
                       const struct bench_overrides *o, struct sp_error *err) {
    const char *source = proto_json_string(proto_json_get(json, "volume"));
    const char *name = proto_json_string(proto_json_get(json, "name"));
    const proto_json *patch = proto_json_get(json, "view"),
                     *cameras = proto_json_get(json, "cameras");
    scene->visible_voxels = -1;
    if (!source)
        return sp_fail(err, SP_ERR_INVALID, "/volume", "a scene names its volume here");
    snprintf(scene->name, sizeof scene->name, "%s", name ? name : source);
    proto_json_integer(proto_json_get(json, "visible_voxels"), &scene->visible_voxels);
    scene->volumes = calloc(1, sizeof *scene->volumes);
    if (!scene->volumes)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a scene");
    if (!load_volume(scene, source, err))
        return false;
    if (scene->skipped[0])
        return true;
    /* A few far elements enlarge the box; the view that sp_view_choose() makes leaves them out. */
    if (sp_volume_info(scene->volume)->elements.kind == SP_KIND_GRID)
        sp_view_init(&scene->view, sp_volume_info(scene->volume), scene->name);
    else
        sp_view_choose(&scene->view, scene->volume, scene->name);
    if (patch && !proto_view_apply(patch, &scene->view, &scene->view, err))
        return false;
    if (!bench_view_override(&scene->view, o, err))
        return false;
    size_t given = proto_json_size(cameras), wanted = o->views ? o->views : ORBIT_VIEWS;
    size_t count = given && given < wanted ? given : wanted;
    scene->camera_count = (unsigned)(count < BENCH_CAMERAS_MAX ? count : BENCH_CAMERAS_MAX);
    scene->cameras = calloc(scene->camera_count, sizeof *scene->cameras);
    if (!scene->cameras)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u cameras", scene->camera_count);
    if (given)
        return read_cameras(scene, cameras, err);
    make_orbit(scene);
    return true;
}

static bool open_json(struct bench_scene *scene, proto_json *json, const char *data,
                      const struct bench_overrides *o, struct sp_error *err) {
    *scene = (struct bench_scene){ .data = data };
    bool ok = json && fill_scene(scene, json, o, err);
    proto_json_free(&json);
    if (!ok)
        bench_scene_close(scene);
    return ok;
}

bool bench_scene_open(struct bench_scene *scene, const char *file, const char *data,
                      const struct bench_overrides *overrides, struct sp_error *err) {
    return open_json(scene, read_json(file, err), data, overrides, err);
}

bool bench_scene_open_volume(struct bench_scene *scene, const char *source, const char *data,
                             const struct bench_overrides *overrides, struct sp_error *err) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "volume", source);
    return json ? open_json(scene, json, data, overrides, err)
                : sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a scene");
}

void bench_scene_close(struct bench_scene *scene) {
    sp_volume_unref(&scene->volume);
    for (unsigned i = 0; scene->volumes && i < scene->volumes->count; i++)
        sp_volume_unref(&scene->volumes->list[i].volume);
    free(scene->volumes);
    free(scene->cameras);
    *scene = (struct bench_scene){ 0 };
}

bool bench_scene_save_volume(const struct bench_scene *scene, const char *path,
                             struct sp_error *err) {
    static const char *const types[SP_TYPE_COUNT] = {
        [SP_UINT8] = "uint8", [SP_INT8] = "int8",     [SP_UINT16] = "uint16",  [SP_INT16] = "int16",
        [SP_INT32] = "int32", [SP_FLOAT32] = "float", [SP_FLOAT64] = "double",
    };
    const struct sp_volume_info *info = sp_volume_info(scene->volume);
    const struct sp_grid *g = &info->grid;
    for (int i = 0; i < 3; i++)
        if (g->coordinates[i] ||
            !(g->direction[i][i] >= 1 && g->origin[i] >= 0 && g->origin[i] <= 0))
            return sp_fail(err, SP_ERR_UNSUPPORTED, path,
                           "only a regular, axis-aligned, even grid that starts at 0 can be saved");
    FILE *file = fopen(path, "wb");
    if (!file)
        return sp_fail(err, SP_ERR_IO, path, "%s", strerror(errno));
    fprintf(file,
            "NRRD0004\ntype: %s\ndimension: 3\nsizes: %u %u %u\nspacings: %.17g %.17g %.17g\n",
            types[info->type], g->dims[0], g->dims[1], g->dims[2], g->spacing[0], g->spacing[1],
            g->spacing[2]);
    fprintf(file, "endian: %s\nencoding: raw\n\n",
            __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? "little" : "big");
    bool ok =
        fwrite(sp_volume_voxels(scene->volume), 1, info->voxel_bytes, file) == info->voxel_bytes;
    if (fclose(file) != 0 || !ok)
        return sp_fail(err, SP_ERR_IO, path, "cannot be written");
    return true;
}
