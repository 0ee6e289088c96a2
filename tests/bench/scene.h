/* SPDX-License-Identifier: Apache-2.0
 *
 * A scene of the bench: a volume, a view, and the cameras from which it is drawn.
 *
 *   { "name": …, "volume": file name below --data or "demo:NAME", "view": patch, "cameras":
 * [patch…] }
 *
 * "name", "view" and "cameras" may be missing: then the volume's id, its default view, and an
 * orbit.
 */
#ifndef BENCH_SCENE_H
#define BENCH_SCENE_H

#include "sp/view.h"
#include "sp/volume.h"

enum { BENCH_CAMERAS_MAX = 4096 };

/* What the command line asks for instead of what the scene says; NULL or 0 = as the scene says. */
struct bench_overrides {
    const char *mode, *compositing, *shading, *lod; /* as in the protocol */
    unsigned size;                                  /* px, both ways */
    unsigned views; /* of an orbit; at most so many of a scene's cameras */
};

struct bench_scene {
    char name[SP_NAME_BYTES];
    char skipped[512]; /* why there is nothing to draw; "" = there is */
    struct sp_volume *volume;
    struct sp_view view;
    struct sp_camera *cameras;
    unsigned camera_count;
    int64_t visible_voxels; /* as the scene's author counted them; −1 = not said */
};

/* Reads a scene file, or makes a scene of a volume: a path or "demo:NAME". A volume that is not
 * there gives a skipped scene. False with *err set for anything else; the scene is then empty. */
bool bench_scene_open(struct bench_scene *scene, const char *file, const char *data,
                      const struct bench_overrides *overrides, struct sp_error *err);
bool bench_scene_open_volume(struct bench_scene *scene, const char *source, const char *data,
                             const struct bench_overrides *overrides, struct sp_error *err);
void bench_scene_close(struct bench_scene *scene);

/* Changes a view as the overrides say; `views` is not part of one. False with *err set for a value
 * that the protocol does not know. */
bool bench_view_override(struct sp_view *view, const struct bench_overrides *overrides,
                         struct sp_error *err);

/* Writes the scene's volume as NRRD, raw. False with *err set if it cannot be written, or if the
 * grid is rectilinear or turned, which the header written here does not tell. */
bool bench_scene_save_volume(const struct bench_scene *scene, const char *path,
                             struct sp_error *err);

#endif
