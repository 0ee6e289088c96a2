/* SPDX-License-Identifier: Apache-2.0
 *
 * A scene of the bench: a volume, a view, and the cameras that render it.
 *
 *   { "name": …, "volume": file name below --data or "demo:NAME", "view": patch, "cameras":
 * [patch…] }
 *
 * "name", "view" and "cameras" are optional; the defaults are the volume's id, its default view and
 * an orbit.
 */
#ifndef BENCH_SCENE_H
#define BENCH_SCENE_H

#include "sp/view.h"
#include "sp/volume.h"

enum { BENCH_CAMERAS_MAX = 4096 };

/* Options of the command line that override the scene; NULL or 0 = value of the scene. */
struct bench_overrides {
    const char *mode, *compositing, *order, *shading, *lod; /* as in the protocol */
    const char *layers;                                     /* a type, or a JSON list */
    unsigned size;                                          /* px, width and height */
    unsigned views; /* views of an orbit, or the most cameras of a scene */
};

struct bench_scene {
    char name[SP_NAME_BYTES];
    char skipped[512]; /* reason to skip the scene; "" = render it */
    struct sp_volume *volume;
    struct bench_volumes *volumes; /* volumes of layers, by id */
    const char *data;              /* as given to bench_scene_open() */
    struct sp_view view;
    struct sp_camera *cameras;
    unsigned camera_count;
    int64_t visible_voxels; /* as stated by the scene; −1 = unknown */
};

/* Reads a scene file, or creates a scene from a volume: a path or "demo:NAME". A missing volume
 * gives a skipped scene. Any other failure returns false with *err set and an empty scene. */
bool bench_scene_open(struct bench_scene *scene, const char *file, const char *data,
                      const struct bench_overrides *overrides, struct sp_error *err);
bool bench_scene_open_volume(struct bench_scene *scene, const char *source, const char *data,
                             const struct bench_overrides *overrides, struct sp_error *err);
void bench_scene_close(struct bench_scene *scene);

/* The volume of a layer's id, for sp_render_options.find(): a file name below the data folder or
 * "demo:NAME", loaded when it is first wanted. NULL after printing why it cannot be loaded. */
struct sp_volume *bench_scene_find(void *scene, const char *id);

/* Applies the overrides, except `views`, to a view. False with *err set for a value that the
 * protocol does not define. */
bool bench_view_override(struct sp_view *view, const struct bench_overrides *overrides,
                         struct sp_error *err);

/* Writes the scene's volume as NRRD, raw. False with *err set if it cannot be written, or if the
 * grid is rectilinear or rotated, which the header written here cannot express. */
bool bench_scene_save_volume(const struct bench_scene *scene, const char *path,
                             struct sp_error *err);

#endif
