/* SPDX-License-Identifier: Apache-2.0
 *
 * The view: everything that a frame depends on, as plain data. `protocol/` produces it from JSON, a
 * session holds it, and the renderer copies it when a frame begins, so that an edit never tears a
 * frame. The JSON pointer of each struct or field stands in quotes; sp_view_validate() reports it
 * as the place of an error.
 *
 * Numbers are finite unless a comment says otherwise. A default in brackets is what sp_view_init()
 * sets. "world unit" is the unit of the volume's grid (sp_volume_info.unit). Terms and formulas:
 * renderer/README.md.
 */
#ifndef SP_VIEW_H
#define SP_VIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/status.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SP_SIZE_MAX 8192 /* px per image side */
enum {
    SP_TF_POINTS_MAX = 256,
    SP_GRADIENT_POINTS_MAX = 16,
    SP_CHANNEL_POINTS_MAX = 32,
    SP_LAYERS_MAX = 8,
    SP_EDITS_MAX = 32,
    SP_LIGHTS_MAX = 8,
    SP_CLIP_PLANES_MAX = 8
};

enum sp_projection { SP_PERSPECTIVE, SP_ORTHOGRAPHIC };
enum sp_filter_mode {
    SP_FILTER_ADAPTIVE,       /* per brick, one of the next three (Chen et al. 2004, eq. 7) */
    SP_FILTER_EWA,            /* footprint and low-pass filter (Zwicker et al. 2001, eq. 21) */
    SP_FILTER_RECONSTRUCTION, /* footprint alone; aliases when minified */
    SP_FILTER_LOWPASS,        /* low-pass filter alone; leaves holes when magnified */
    SP_FILTER_SWAN,           /* footprint scaled up to the low-pass radius (Swan et al. 1997) */
    SP_FILTER_NONE            /* a flat rectangle per voxel (Botha and Post 2003) */
};
enum sp_kernel { SP_KERNEL_GAUSSIAN, SP_KERNEL_CUBIC /* Crawfis and Max 1993 */ };
enum sp_compositing {
    SP_COMPOSITE_SPLAT, /* each splat on its own, sorted by distance */
    SP_COMPOSITE_SHEET, /* slices along the axis closest to the view direction (Westover 1990) */
    /* Slabs of equal distance from the eye (Mueller and Crawfis 1998). With order post and the
     * default filter: interpolated sheets half a slice apart. */
    SP_COMPOSITE_SLAB,
    /* Projections: one number per pixel, of the interpolated values along its ray inside the volume
     * and the clip. Samples that are not finite are left out. */
    SP_COMPOSITE_MAXIMUM,
    SP_COMPOSITE_MINIMUM,
    SP_COMPOSITE_MEAN,
    SP_COMPOSITE_SUM /* the integral of max(value − zero, 0), data unit · world unit; or the share
                        of X-rays that is absorbed */
};
/* How the number of a projection becomes a colour. */
enum sp_projection_colors {
    SP_COLORS_GREY,             /* the window: from black to white */
    SP_COLORS_TRANSFER_FUNCTION /* colour and opacity of the transfer function: what one reference
                                   length of the value looks like */
};
/* Opacity of optical depth T: 1 − e^−T, or min(T, 1). */
enum sp_attenuation { SP_ATTENUATION_EXPONENTIAL, SP_ATTENUATION_LINEAR };
enum sp_tf_order {
    SP_TF_PRE,  /* classify voxels */
    SP_TF_POST, /* classify pixels */
    SP_TF_AUTO  /* post for sheets and slabs with the default filter, if voxels are at least 0.35 px
                   wide, and the backend interpolates sheets and has the memory for it; else, and
                   for mip levels, pre */
};
enum sp_shading_mode { SP_SHADING_NONE, SP_SHADING_PHONG };
enum sp_light_space { SP_LIGHT_CAMERA, SP_LIGHT_WORLD };
enum sp_lod { SP_LOD_AUTO, SP_LOD_OFF };

struct sp_camera {                 /* "/camera" */
    enum sp_projection projection; /* [perspective] */
    double position[3];            /* eye, world, each in ±SP_POSITION_MAX [frames the volume] */
    double target[3]; /* world point in the centre of the image; differs from position [the volume's
                         centre] */
    double up[3];     /* any length but 0, not parallel to the view direction [±z] */
    double fov_y;     /* vertical angle, degrees, [1, 170]; perspective only [30] */
    double height;    /* world units that the image shows vertically, > 0; orthographic only
                         [diameter of the volume] */
    double near;      /* distance of the near plane, world units, > 0: nearer voxels are not drawn
                         [0.1 · smallest spacing] */
};

struct sp_tf_point {
    double value;   /* data unit; rises strictly along the list */
    float color[3]; /* sRGB display values, [0, 1]; composited as they are */
    float opacity;  /* [0, 1), over the reference length; 0 = transparent */
};
struct sp_gradient_point {
    double magnitude; /* data unit per world unit, >= 0; rises strictly along the list */
    float scale;      /* [0, 1]; multiplies the opacity */
};
/* extinction = −ln(1 − opacity) / reference_length. Linear between points; the first and the last
 * point hold beyond the ends. */
struct sp_transfer_function {                    /* "/transfer_function" */
    double reference_length;                     /* world units, > 0 [smallest spacing] */
    enum sp_tf_order order;                      /* "post" needs "sheet" or "slab" [auto] */
    uint32_t point_count;                        /* [1, SP_TF_POINTS_MAX] */
    struct sp_tf_point points[SP_TF_POINTS_MAX]; /* [from the histogram] */
    uint32_t gradient_count; /* [0, SP_GRADIENT_POINTS_MAX]; 0 = magnitude has no influence [0] */
    struct sp_gradient_point gradient[SP_GRADIENT_POINTS_MAX];
};

struct sp_filter {            /* "/filter" */
    enum sp_filter_mode mode; /* [adaptive] */
    enum sp_kernel kernel;    /* [gaussian] */
    double sigma;             /* standard deviation, voxels, [0.3, 2]; gaussian only [0.7] */
    double cutoff;  /* Mahalanobis radius where footprints end, [1, 6]; gaussian only [3] */
    double lowpass; /* standard deviation of the low-pass filter, px, [0, 8]; 0 = none [1] */
    double c_min; /* adaptive threshold (Chen et al. 2004, eq. 7), no unit, > 0, <= c_max [0.07] */
    double c_max; /* the same, > 0; NaN (JSON null) = 2.5·(1 + 2·tan²(fov_y / 2)) [NaN] */
};

struct sp_compositing_options {      /* "/compositing" */
    enum sp_compositing mode;        /* [sheet] */
    enum sp_attenuation attenuation; /* [exponential] */
    double slab; /* thickness in smallest (mean) spacings, of points in their size, [0.05, 64]; slab
                    mode only, and not where slabs are interpolated [1] */
    /* Of projections: */
    enum sp_projection_colors colors; /* "transfer_function" is not for sums [grey] */
    /* "window", in the unit of the number: centre, and width > 0 from black to white. NaN (JSON
     * null) = chosen for the volume and the mode, sp_projection_window() [NaN] */
    double center, width;
    double zero; /* sum: lower values count as this one; NaN = the volume's smallest value [NaN] */
    /* sum: X-rays. Attenuation per data unit above `zero`, 1 / world unit, > 0: the pixel shows the
     * absorbed share 1 − e^−∫attenuation, [0, 1]. NaN = the integral itself [NaN] */
    double absorption;
};

struct sp_light {
    double direction[3]; /* towards the light, any length but 0; camera space: x right, y up, z
                            towards the viewer */
    enum sp_light_space space; /* of `direction` */
    float color[3];            /* [0, 4]; 0 = dark */
};
struct sp_shading {                    /* "/shading" */
    enum sp_shading_mode mode;         /* [phong] */
    double ambient, diffuse, specular; /* weights, [0, 4]; 0 = none [0.25, 0.8, 0.25] */
    double exponent;                   /* of the highlight (Blinn 1977), [1, 1024] [24] */
    /* Strength of ambient occlusion and of the shadow of the first light, [0, 1]; 0 = none [0].
     * They need mode phong, and are drawn with compositing.mode sheet and transfer_function.order
     * post; renderer/draw/light/README.md. With mode none they have no effect. */
    double occlusion, shadow;
    uint32_t light_count; /* [0, SP_LIGHTS_MAX]; 0 = ambient light alone [1] */
    struct sp_light lights[SP_LIGHTS_MAX];
};

struct sp_clip_plane {
    double normal[3]; /* world, any length but 0 */
    double offset;    /* keeps the half space dot(normal, world) >= offset */
};
struct sp_clip {      /* "/clip" */
    double box[2][3]; /* lower and upper corner, fractions of the volume's extent, [0, 1] [all] */
    uint32_t plane_count; /* [0, SP_CLIP_PLANES_MAX] [0] */
    struct sp_clip_plane planes[SP_CLIP_PLANES_MAX];
};

enum sp_layer_type {
    SP_LAYER_VOLUME,  /* the whole volume through transfer function, filter and compositing */
    SP_LAYER_SURFACE, /* an iso-surface, by surface splatting (Zwicker et al. 2001, section 5) */
    SP_LAYER_SHELL,   /* voxels at borders of opacity (Botha and Post 2003) */
    SP_LAYER_VECTORS, /* streaks along the vectors of the volume's samples or points (Crawfis and
                         Max 1993) */
    /* Elements of a volume without a grid (sp/elements.h): */
    SP_LAYER_POINTS,    /* through the transfer function, each composited on its own */
    SP_LAYER_GAUSSIANS, /* a trained scene (Kerbl et al. 2023) */
    SP_LAYER_GEOMETRY,  /* triangles */
    /* Another volume on the grid of the view's volume, such as another field of its file, with a
     * transfer function of its own. Both fill the same space: their extinctions add up, and their
     * colours add up as light does, with the mean brightness; in a projection, colours add up.
     * Needs compositing.mode sheet or slab with order post, or a projection; occlusion and shadow
     * have no effect, and edits of type part are refused. */
    SP_LAYER_CHANNEL
};
enum { SP_LAYER_TYPES = SP_LAYER_CHANNEL + 1 };
/* How the low-pass filter of 0.3 px² changes a Gaussian. */
enum sp_convention {
    SP_CONVENTION_INRIA,     /* wider, opacity as it is (Kerbl et al. 2023) */
    SP_CONVENTION_NORMALISED /* wider and as much more transparent (Yu et al. 2024) */
};
#define SP_COLOR_BY_LENGTH "magnitude" /* struct sp_layer: color_by */
enum sp_layer_colors { SP_COLORS_OWN, SP_COLORS_OF_LAYER };
enum sp_shell_detail {
    SP_SHELL_HIGH, /* Gaussian footprints of filter.sigma and filter.cutoff */
    SP_SHELL_FAST  /* a flat square of 1.6 voxels per voxel */
};
enum sp_vectors_style {
    SP_VECTORS_MODULATE, /* streaks are denser than what is between them */
    SP_VECTORS_BLEND     /* streaks of one colour over the splats of the samples */
};
/* One of several things that are drawn into one image, each in front of what is farther from the
 * eye. Clipping applies to all of them. Fields of other types are ignored. */
struct sp_layer { /* "/layers/0" */
    enum sp_layer_type type;
    bool visible; /* false = as if the layer did not exist [true] */
    double value; /* surface: iso-value, data unit; outside of the range nothing is drawn */
    /* surface, geometry, the streaks of style blend, and a channel without points: sRGB display
     * values, [0, 1] [0.9, 0.85, 0.75] */
    float color[3];
    /* surface; gaussians, geometry: factor on their own. [0, 1]; 0 = invisible [1] */
    float opacity;
    /* surface: kernels are this many times flatter along the gradient, [1, infinity]; 1 = the
     * volume's kernels, infinity (JSON "inf") = discs [infinity] */
    double flatness;
    /* shell: thresholds of a voxel's opacity over the reference length, [0, 1], low <= high. A
     * voxel is in the shell if its opacity is at least `low`, and that of one of its six neighbours
     * is below `high`. [0.05, 0.95] */
    double low, high;
    enum sp_shell_detail detail; /* shell [high] */
    /* vectors: samples, or points, are coloured by the transfer function, and streaks lie along
     * their vectors. Samples whose vector is 0 or not finite have no streaks. */
    enum sp_vectors_style style; /* [modulate] */
    double phase;   /* vectors: how far streaks have moved, in streaks, [-1e6, 1e6]; 1 is like 0
                       [0] */
    double stretch; /* vectors: kernels are this many times longer along the vector, [1, 8] [4] */
    double density; /* vectors: share of the samples that are drawn, [0, 1]; the same ones at each
                       time [0.2] */
    /* vectors, points: what gives the colours in place of the values, one number per sample or
     * point: "magnitude" = the length of its vector; else the id of a volume with as many samples,
     * such as another field of the same file, resolved by sp_render_options.find(); "" = the values
     * [""]. Opacities stay those of the values. */
    char color_by[SP_NAME_BYTES];
    /* color_by: numbers that have the colours of the first and of the last point of the transfer
     * function, low < high. NaN (JSON null) = the smallest and the largest number; for "magnitude",
     * 0 and the largest length. [NaN] */
    double color_low, color_high;
    /* points, gaussians, geometry: the volume that has them; "" = the frame's volume. channel: the
     * volume that it shows, not "", another one for each channel. Resolved by
     * sp_render_options.find() [""] */
    char id[SP_NAME_BYTES];
    /* points, gaussians, geometry: from the world of the data to that of the view, row by row;
     * affine (the last row is 0 0 0 1), not singular [identity] */
    double transform[16];
    double size;                   /* points: factor on the size of their kernels, [0.1, 10] [1] */
    enum sp_convention convention; /* gaussians [inria] */
    enum sp_layer_colors colors;   /* geometry: of the vertices, or `color` [own] */
    /* channel: the transfer function, like that of the view, whose reference_length holds here,
     * too. point_count, [0, SP_CHANNEL_POINTS_MAX]: 0 = the function of sp_channel_function() [0]
     */
    uint32_t point_count;
    struct sp_tf_point points[SP_CHANNEL_POINTS_MAX];
};

enum sp_edit_type {
    SP_EDIT_PLANE, /* keeps one side */
    SP_EDIT_BOX,   /* along the axes of the grid */
    SP_EDIT_SPHERE,
    SP_EDIT_PART /* the samples in a range of values that are connected with a point */
};
enum sp_edit_keep { SP_KEEP_OUTSIDE, SP_KEEP_INSIDE };
/* Removes samples from what all layers show. The volume is never changed. Fields of other types are
 * ignored. renderer/inspect/edit/README.md says what takes the place of removed samples. */
struct sp_edit { /* "/edits/0" */
    enum sp_edit_type type;
    enum sp_edit_keep keep; /* box, sphere, part: what stays [outside] */
    double normal[3];       /* plane: world, any length but 0 */
    double offset;          /* plane: keeps the half space dot(normal, world) >= offset */
    double box[2][3]; /* box: lower and upper corner, fractions of the volume's extent, [0, 1] */
    double center[3]; /* sphere: world, each in ±SP_POSITION_MAX */
    double radius;    /* sphere: world units, > 0 */
    double point[3];  /* part: world, each in ±SP_POSITION_MAX */
    double range[2];  /* part: lowest and highest value, data unit */
};

enum sp_slice_mode {
    SP_SLICES_NONE,
    SP_SLICES_ORTHOGONAL, /* three planes through the position, along the axes of the grid */
    SP_SLICES_OBLIQUE     /* one plane through the position */
};
/* How slices show values: in grey or in a colour map over the window, or in the colours of the
 * transfer function, whatever its opacity. */
enum sp_slice_colors {
    SP_SLICE_GREY,
    SP_SLICE_TRANSFER_FUNCTION,
    SP_SLICE_VIRIDIS,
    SP_SLICE_INFERNO,
    SP_SLICE_CIVIDIS,
    SP_SLICE_TURBO,
    SP_SLICE_BLUE_RED
};
/* Slices of the volume (sp/slice.h) that clients show beside the image, and in it. A slice in the
 * image is opaque, reaches to the borders of the volume whatever the clip is, and hides what is
 * behind it; the volume in front of it is drawn as always. Pixels on a border are covered in part.
 * Values that are not finite leave a hole, and so do the view's edits. */
struct sp_slices {           /* "/slices" */
    enum sp_slice_mode mode; /* [none] */
    bool in_3d;              /* draw them in the image [false]; oblique: needs one of the clip
                                planes, so that the view has at most SP_CLIP_PLANES_MAX - 1 */
    bool planes[3];          /* orthogonal: draw the slice across this axis of the grid [true] */
    double position[3];      /* world [the volume's centre] */
    double normal[3];        /* of the oblique slice, world, any length but 0 [z] */
    double center, width;    /* "window": values from black to white, or from the first to the last
                                colour of the map; width > 0 [sp_slice_default_window()] */
    enum sp_slice_colors colors; /* [grey] */
};

struct sp_time {   /* "/time" */
    uint32_t step; /* of the volume's time series, below sp_steps.count; the caller resolves it, the
                      renderer ignores it [the step that was loaded] */
};

struct sp_view {
    char volume[SP_NAME_BYTES]; /* "/volume": id; the caller resolves it, the renderer ignores it */
    uint32_t size[2];           /* "/size": width, height, px, [1, SP_SIZE_MAX] [512, 512] */
    float background[4];        /* "/background": RGBA, straight alpha, [0, 1] [opaque black] */
    struct sp_camera camera;
    struct sp_transfer_function transfer_function;
    struct sp_filter filter;
    struct sp_compositing_options compositing;
    struct sp_shading shading;
    uint32_t layer_count; /* [1, SP_LAYERS_MAX] [1] */
    /* "/layers": in any order; at most one volume, one shell and one layer of vectors [the volume,
     * or its elements] */
    struct sp_layer layers[SP_LAYERS_MAX];
    struct sp_clip clip;
    uint32_t edit_count;                /* [0, SP_EDITS_MAX] [0] */
    struct sp_edit edits[SP_EDITS_MAX]; /* "/edits": in this order */
    enum sp_lod level_of_detail;        /* "/quality/level_of_detail" [auto] */
    struct sp_time time;
    struct sp_slices slices;
};

/* Fills *view with the defaults that the description of a volume gives: the camera frames the grid,
 * and the transfer function comes from the histogram. `id` is copied to view->volume. Thread-safe;
 * never fails. */
SP_API void sp_view_init(struct sp_view *view, const struct sp_volume_info *info, const char *id);

/* The same, with the camera and the transfer function from the samples: the first view that a
 * person sees of a volume. The surroundings are transparent, what is visible fills the image, and
 * up is up as far as the file or the shape tells; renderer/data/default_view/README.md. Reads at
 * most 2 million samples, on this thread. The result depends on the volume alone. Where nothing can
 * be found (a single value, no memory), it equals sp_view_init(). Thread-safe; never fails. */
SP_API void sp_view_choose(struct sp_view *view, const struct sp_volume *volume, const char *id);

/* The defaults of a layer of that type; a surface has no value yet (NaN). Thread-safe. */
SP_API struct sp_layer sp_layer_default(enum sp_layer_type type);

/* Writes the transfer function of a channel of the view. Without points of its own it rises from
 * transparent to `color` and opacity 0.5 within sp_slice_default_window() of `info`, the volume
 * that the channel shows; if its samples are all equal, all is transparent. Thread-safe. */
SP_API void sp_channel_function(const struct sp_view *view, const struct sp_layer *channel,
                                const struct sp_volume_info *info,
                                struct sp_transfer_function *function);

/* True if a visible layer of the view is a channel. Thread-safe. */
SP_API bool sp_view_has_channels(const struct sp_view *view);

/* True for the modes that show one number of the values along a ray. Thread-safe. */
static inline bool sp_compositing_is_projection(enum sp_compositing mode) {
    return mode >= SP_COMPOSITE_MAXIMUM;
}

/* Writes centre and width of the window of the view's projection: what `compositing` gives, and
 * where it is NaN what suits the volume:
 *
 *   maximum, mean   the numbers of nearly all rays through the volume (sp_projected)
 *   sum             from 0 to the upper end of those numbers; times the root mean square of
 *                   max(value − zero, 0), over that for the smallest value as zero; with
 *                   absorption from 0 to 1
 *   minimum         from the lower end of sp_slice_default_window() to the largest value
 *
 * The width is above 0. Thread-safe. */
SP_API void sp_projection_window(const struct sp_view *view, const struct sp_volume_info *info,
                                 double window[2]);

/* True if slices are drawn in the image: not in a projection. Thread-safe. */
SP_API bool sp_view_draws_slices(const struct sp_view *view);

/* True if all fields have the same values. Lists are compared up to their counts, names up to their
 * ends, and the fields of a layer or an edit whatever its type is. NaN equals NaN; 0 and -0 differ.
 * Do not compare views by their bytes: padding and unused entries have any value. Counts must be
 * within their limits. Thread-safe. */
SP_API bool sp_view_equal(const struct sp_view *a, const struct sp_view *b);
/* The same for one part of a view. */
SP_API bool sp_transfer_function_equal(const struct sp_transfer_function *a,
                                       const struct sp_transfer_function *b);

/* True if the two views give the same image, although they may differ in slices that are not
 * drawn in it. Thread-safe. */
SP_API bool sp_view_is_same_image(const struct sp_view *a, const struct sp_view *b);

/* True if all of view->filter is as sp_view_init() sets it. Thread-safe. */
SP_API bool sp_view_has_default_filter(const struct sp_view *view);

/* Checks every range above and the camera. On failure the code is SP_ERR_INVALID and err->place the
 * JSON pointer of the field. What a backend supports is checked by the renderer
 * (sp_renderer_supports()). Thread-safe. */
SP_API bool sp_view_validate(const struct sp_view *view, struct sp_error *err);

/* True if the volume has what the view's visible layers without an id show, and a grid of samples
 * if the view has edits or slices in the image. SP_ERR_INVALID; err->place is the JSON pointer. The
 * view must be valid. Thread-safe. */
SP_API bool sp_view_fits(const struct sp_view *view, const struct sp_volume_info *info,
                         struct sp_error *err);
/* The same for one layer and the volume that it shows. */
SP_API bool sp_view_layer_fits(const struct sp_view *view, uint32_t layer,
                               const struct sp_volume_info *info, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
