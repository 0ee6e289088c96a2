/* SPDX-License-Identifier: Apache-2.0
 *
 * The view: everything that a frame depends on, as plain data. It is produced by `protocol/` from
 * JSON, held by a session, and copied by value when a frame starts, so that an edit never tears a
 * frame. The JSON pointer of each field is given in quotes; sp_view_validate() reports it as place.
 */
#ifndef SP_VIEW_H
#define SP_VIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/status.h"
#include "sp/volume.h"

#define SP_SIZE_MAX 8192 /* px an image side */
enum {
    SP_TF_POINTS_MAX = 256,
    SP_GRADIENT_POINTS_MAX = 16,
    SP_LIGHTS_MAX = 8,
    SP_CLIP_PLANES_MAX = 8
};

enum sp_projection { SP_PERSPECTIVE, SP_ORTHOGRAPHIC };
enum sp_filter_mode {
    SP_FILTER_ADAPTIVE,
    SP_FILTER_EWA,
    SP_FILTER_RECONSTRUCTION,
    SP_FILTER_LOWPASS,
    SP_FILTER_SWAN,
    SP_FILTER_NONE
};
enum sp_kernel { SP_KERNEL_GAUSSIAN, SP_KERNEL_CUBIC };
enum sp_compositing { SP_COMPOSITE_SPLAT, SP_COMPOSITE_SHEET, SP_COMPOSITE_SLAB };
enum sp_attenuation { SP_ATTENUATION_EXPONENTIAL, SP_ATTENUATION_LINEAR };
enum sp_tf_order { SP_TF_PRE, SP_TF_POST };
enum sp_shading_mode { SP_SHADING_NONE, SP_SHADING_PHONG };
enum sp_light_space { SP_LIGHT_CAMERA, SP_LIGHT_WORLD };
enum sp_primitive {
    SP_PRIMITIVE_VOLUME,
    SP_PRIMITIVE_SURFACE,
    SP_PRIMITIVE_SHELL,
    SP_PRIMITIVE_VECTOR
};
enum sp_lod { SP_LOD_AUTO, SP_LOD_OFF };

struct sp_camera {                 /* "/camera" */
    enum sp_projection projection; /* "perspective" (default) | "orthographic" */
    double position[3];            /* eye, world */
    double target[3]; /* point that is seen in the middle, world; must differ from position */
    double up[3];     /* not zero, not parallel to the view direction */
    double fov_y;     /* degrees, vertical, [1, 170], default 30; perspective only */
    double height;    /* world units seen vertically, > 0; orthographic only */
    double near;      /* > 0, world units; voxels nearer than this plane are not drawn */
};

struct sp_tf_point {
    double value;   /* in the data's own unit; strictly rising along the list */
    float color[3]; /* sRGB display values, [0,1], composited as they are */
    float opacity;  /* [0,1), over reference_length */
};
struct sp_gradient_point {
    double magnitude; /* data unit a world unit, >= 0, strictly rising */
    float scale;      /* [0,1], multiplies the opacity */
};
struct sp_transfer_function { /* "/transfer_function" */
    double reference_length;  /* world units, > 0; default: the smallest spacing */
    enum sp_tf_order order;   /* "pre" (default) | "post", which needs slabs */
    uint32_t point_count;     /* [1, SP_TF_POINTS_MAX] */
    struct sp_tf_point points[SP_TF_POINTS_MAX]; /* linear between; the end values hold outside */
    uint32_t gradient_count; /* [0, SP_GRADIENT_POINTS_MAX]; 0 = magnitude has no influence */
    struct sp_gradient_point gradient[SP_GRADIENT_POINTS_MAX];
};

struct sp_filter { /* "/filter"; see mathematics: footprint, filters */
    enum sp_filter_mode mode;
    enum sp_kernel kernel;
    double sigma;        /* voxels, [0.3, 2], default 0.7; gaussian only */
    double cutoff;       /* Mahalanobis radius, [1, 6], default 3; gaussian only */
    double lowpass;      /* standard deviation in px, [0, 8], default 1 */
    double c_min, c_max; /* adaptive thresholds, > 0, c_min <= c_max; c_min 0.07; c_max NaN (JSON
                            null) = 2.5(1+2tan²(fov/2)) */
};

struct sp_compositing_options {      /* "/compositing" */
    enum sp_compositing mode;        /* default sheet */
    enum sp_attenuation attenuation; /* default exponential */
    double slab; /* thickness in smallest (mean) spacings, [0.05, 64], default 1; slab mode only */
};

struct sp_light {
    double direction[3]; /* towards the light, not zero; camera space: x right, y up, z towards the
                            viewer */
    enum sp_light_space space;
    float color[3]; /* [0,4] */
};
struct sp_shading { /* "/shading" */
    enum sp_shading_mode mode;
    double ambient, diffuse, specular; /* [0,4] */
    double exponent;                   /* Blinn, [1, 1024] */
    uint32_t light_count;              /* [0, SP_LIGHTS_MAX] */
    struct sp_light lights[SP_LIGHTS_MAX];
};

struct sp_clip_plane {
    double normal[3], offset;
};                    /* keeps dot(normal, world) >= offset */
struct sp_clip {      /* "/clip" */
    double box[2][3]; /* lower and upper corner as fractions of the volume's extent, [0,1]; default
                         the whole */
    uint32_t plane_count;
    struct sp_clip_plane planes[SP_CLIP_PLANES_MAX];
};

struct sp_view {
    char volume[SP_NAME_BYTES]; /* "/volume": id; the renderer ignores it, its caller resolves it */
    uint32_t size[2];    /* "/size": width, height in px, [1, SP_SIZE_MAX], default 512×512 */
    float background[4]; /* "/background": RGBA, not associated, [0,1], default opaque black */
    struct sp_camera camera;
    struct sp_transfer_function transfer_function;
    struct sp_filter filter;
    struct sp_compositing_options compositing;
    struct sp_shading shading;
    enum sp_primitive primitive; /* "/primitive/type" */
    struct sp_clip clip;
    enum sp_lod level_of_detail; /* "/quality/level_of_detail" */
};

/* Fills *view with the default for a volume: the camera frames it (perspective, 30°), the transfer
 * function comes from its histogram. `id` is copied to view->volume. Pure; never fails. */
void sp_view_init(struct sp_view *view, const struct sp_volume_info *info, const char *id);

/* Checks every range above and the camera. On failure err->place is the JSON pointer of the culprit
 * and the code SP_ERR_INVALID. It does not check what a backend supports: the renderer does
 * (SP_ERR_UNSUPPORTED, with the pointer and what is supported). Pure. */
bool sp_view_validate(const struct sp_view *view, struct sp_error *err);

#endif
