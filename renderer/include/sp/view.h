/* SPDX-License-Identifier: Apache-2.0
 *
 * The view: everything that a frame depends on, as plain data. `protocol/` produces it from JSON, a
 * session holds it, and the renderer copies it when a frame begins. So a change of the view never
 * mixes two states in one frame. The JSON pointer of each struct or field is given in quotes;
 * sp_view_validate() reports it as the place of an error.
 *
 * Numbers are finite unless a comment says otherwise. A default in brackets is the value that
 * sp_view_init() sets. "world unit" is the unit of the volume's grid (sp_volume_info.unit). Terms
 * and formulas: renderer/README.md.
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
    /* Projections: one number per pixel, computed from the interpolated values along its ray inside
     * the volume and the clip. NaN and infinite samples are left out. */
    SP_COMPOSITE_MAXIMUM,
    SP_COMPOSITE_MINIMUM,
    SP_COMPOSITE_MEAN,
    SP_COMPOSITE_SUM /* the integral of max(value − zero, 0) [data unit · world unit], or the
                        absorbed fraction of X-rays */
};
/* How a projection turns its number into a colour. */
enum sp_projection_colors {
    SP_COLORS_GREY,             /* the window: from black to white */
    SP_COLORS_TRANSFER_FUNCTION /* colour and opacity of the transfer function at this value, over
                                   one reference length */
};
/* Opacity of optical depth T: 1 − e^−T, or min(T, 1). */
enum sp_attenuation { SP_ATTENUATION_EXPONENTIAL, SP_ATTENUATION_LINEAR };
enum sp_tf_order {
    SP_TF_PRE,  /* classify voxels */
    SP_TF_POST, /* classify pixels */
    SP_TF_AUTO  /* post for sheets and slabs with the default filter, if voxels are at least 0.35 px
                   wide and the backend interpolates sheets and has the memory for that; otherwise,
                   and for mip levels, pre */
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
    double near;      /* distance of the near plane, world units, > 0: nearer voxels are not drawn;
                         of splats close to the eye, nearer parts are not
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
    double sigma;   /* standard deviation of the kernel, voxels, [0.3, 2]; gaussian only [0.7] */
    double cutoff;  /* Mahalanobis radius where footprints end, [1, 6]; gaussian only. From 3 on,
                       post-convolved sheets of the CPU draw the Gaussian without an end [3] */
    double lowpass; /* standard deviation of the low-pass filter, px, [0, 8]; 0 = none [1] */
    double c_min;   /* lower adaptive threshold (Chen et al. 2004, eq. 7), no unit, > 0, <= c_max
                       [0.07] */
    double c_max; /* upper adaptive threshold, no unit, > 0; NaN (JSON null) = 2.5·(1 + 2·tan²(fov_y
                     / 2)) [NaN] */
};

struct sp_compositing_options {      /* "/compositing" */
    enum sp_compositing mode;        /* [sheet] */
    enum sp_attenuation attenuation; /* [exponential] */
    double slab; /* slab thickness, [0.05, 64], in units of the smallest mean spacing; for points in
                    units of their size; mode slab only, unless slabs are interpolated [1] */
    /* Fields of projections: */
    enum sp_projection_colors colors; /* "transfer_function" is not for sums [grey] */
    /* "window", in the unit of the projected number: centre, and width > 0 from black to white. NaN
     * (JSON null) = sp_projection_window() chooses for the volume and the mode [NaN] */
    double center, width;
    double zero; /* sum: lower values count as `zero`; NaN = the volume's smallest value [NaN] */
    /* sum as X-rays: attenuation per data unit above `zero` [1 / world unit], > 0. The pixel shows
     * the absorbed fraction 1 − e^−∫attenuation, [0, 1]. NaN = the integral itself [NaN] */
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
    /* Sheets and slabs that are classified per pixel: how smooth normals are, [0, 1]: 0 = from the
     * finest gradients, 1 = from smooth ones. NaN = as smooth as the volume's noise asks for, and,
     * with level of detail, smoother where samples are narrower than 1.2 px
     * (renderer/draw/resample/gradient.h). [NaN] */
    double smoothing;
    /* Strength of ambient occlusion and of the shadow of the first light, [0, 1]; 0 = none [0].
     * They need mode phong, and are drawn with compositing.mode sheet and transfer_function.order
     * post; renderer/draw/light/README.md. With mode none they have no effect. */
    double occlusion, shadow;
    /* How far ambient occlusion reaches, [0.01, 10] diagonals of the volume: matter that far away
     * occludes e times less than matter nearby [0.2]. */
    double reach;
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
     * transfer function of its own. Both volumes fill the same space: their extinctions add up, and
     * their colours mix like light, with the mean brightness. In a projection, colours add up.
     * Needs compositing.mode sheet or slab with order post, or a projection; occlusion and shadow
     * have no effect, and edits of type part are refused. */
    SP_LAYER_CHANNEL
};
enum { SP_LAYER_TYPES = SP_LAYER_CHANNEL + 1 };
/* How the low-pass filter of 0.3 px² changes a Gaussian. */
enum sp_convention {
    SP_CONVENTION_INRIA,     /* wider, with the same opacity (Kerbl et al. 2023) */
    SP_CONVENTION_NORMALISED /* wider, and more transparent by the same factor (Yu et al. 2024) */
};
#define SP_COLOR_BY_LENGTH "magnitude" /* struct sp_layer: color_by */
enum sp_layer_colors { SP_COLORS_OWN, SP_COLORS_OF_LAYER };
enum sp_shell_detail {
    SP_SHELL_HIGH, /* Gaussian footprints of filter.sigma and filter.cutoff */
    SP_SHELL_FAST  /* a flat square of 1.6 voxels per voxel */
};
enum sp_vectors_style {
    SP_VECTORS_MODULATE, /* streaks are denser than the space between them */
    SP_VECTORS_BLEND     /* streaks of one colour over the splats of the samples */
};
/* One layer of an image. All layers are drawn into the same image, sorted by depth, and clipping
 * applies to all of them. Fields that belong to other types are ignored. */
struct sp_layer { /* "/layers/0" */
    enum sp_layer_type type;
    bool visible; /* false = as if the layer did not exist [true] */
    /* surface: iso-value, data unit; outside of the volume's range nothing is drawn */
    double value;
    /* surface, geometry, streaks of style blend, channel without points: sRGB display values, [0,
     * 1] [0.9, 0.85, 0.75] */
    float color[3];
    /* surface: opacity; gaussians, geometry: factor on their own opacity. [0, 1]; 0 = invisible
     * [1] */
    float opacity;
    /* surface: factor by which kernels are flattened along the gradient, [1, infinity]; 1 = the
     * kernels of the volume, infinity (JSON "inf") = discs [infinity] */
    double flatness;
    /* shell: thresholds of a voxel's opacity over the reference length, [0, 1], low <= high. A
     * voxel is in the shell if its opacity is at least `low` and the opacity of one of its six
     * neighbours is below `high`. [0.05, 0.95] */
    double low, high;
    enum sp_shell_detail detail; /* shell [high] */
    /* vectors: the transfer function colours samples or points, and streaks lie along their
     * vectors. A sample whose vector is 0 or not finite has no streak. */
    enum sp_vectors_style style; /* [modulate] */
    double phase; /* vectors: how far streaks have moved, in periods, [-1e6, 1e6]; 1 looks like 0
                     [0] */
    /* vectors: factor by which kernels are stretched along the vector, [1, 8] [4] */
    double stretch;
    double density; /* vectors: fraction of the samples that are drawn, [0, 1]; the same samples in
                       every frame [0.2] */
    /* vectors, points: the numbers that give the colours instead of the values, one per sample or
     * point. "" = the values; "magnitude" = the length of the vector; otherwise the id of a volume
     * with as many samples, such as another field of the same file, resolved by
     * sp_render_options.find() [""]. Opacities still come from the values. */
    char color_by[SP_NAME_BYTES];
    /* color_by: the numbers that get the colours of the first and the last point of the transfer
     * function, low < high. NaN (JSON null) = the smallest and the largest number; for "magnitude",
     * 0 and the largest length [NaN] */
    double color_low, color_high;
    /* points, gaussians, geometry: id of the volume that has the elements; "" = the frame's volume.
     * channel: id of the volume that the channel shows, not "", different for each channel.
     * Resolved by sp_render_options.find() [""] */
    char id[SP_NAME_BYTES];
    /* points, gaussians, geometry: matrix from the world of the data to the world of the view, row
     * by row; affine (the last row is 0 0 0 1), not singular [identity] */
    double transform[16];
    double size;                   /* points: factor on the size of their kernels, [0.1, 10] [1] */
    enum sp_convention convention; /* gaussians [inria] */
    enum sp_layer_colors colors;   /* geometry: colours of the vertices, or `color`, which
                                      a mesh without colours also takes [own] */
    /* channel: the transfer function, as in struct sp_transfer_function, with the reference_length
     * of the view. point_count: [0, SP_CHANNEL_POINTS_MAX]; 0 = the function of
     * sp_channel_function() [0]
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
/* An edit removes samples from all layers. The volume itself never changes. Fields that belong to
 * other types are ignored. renderer/inspect/edit/README.md describes the values that replace
 * removed samples. */
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
/* Slices of the volume (sp/slice.h) that clients show beside the image, or that are drawn in the
 * image. A slice in the image is opaque and hides everything behind it; the volume in front of it
 * is drawn as usual. The clip does not cut the slice: it reaches the borders of the volume. Pixels
 * on a border are covered partially. NaN, infinite values and the view's edits leave holes. */
struct sp_slices {           /* "/slices" */
    enum sp_slice_mode mode; /* [none] */
    bool in_3d; /* draw the slices in the image [false]; an oblique slice uses up one clip plane, so
                   the view may have at most SP_CLIP_PLANES_MAX - 1 */
    bool planes[3];       /* orthogonal: draw the slice across this axis of the grid [true] */
    double position[3];   /* world [the volume's centre] */
    double normal[3];     /* of the oblique slice, world, any length but 0 [z] */
    double center, width; /* "window": values from black to white, or from the first to the last
                             colour of the map; width > 0 [sp_slice_default_window()] */
    enum sp_slice_colors colors; /* [grey] */
};

struct sp_time {   /* "/time" */
    uint32_t step; /* step of the volume's time series, below sp_steps.count; the caller resolves
                      it, and the renderer ignores it [the loaded step] */
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
    enum sp_lod level_of_detail;        /* "/quality/level_of_detail" [auto]; also filters pixels
                                           and smooths silhouettes of clipped volumes */
    struct sp_time time;
    struct sp_slices slices;
};

/* Fills *view with defaults from the description of a volume: the camera frames the grid, and the
 * transfer function comes from the histogram. `id` is copied to view->volume. Thread-safe; never
 * fails. */
SP_API void sp_view_init(struct sp_view *view, const struct sp_volume_info *info, const char *id);

/* Like sp_view_init(), but computes the camera and the transfer function from the samples: the
 * first view that a user sees of a volume. The surroundings are transparent, the visible part fills
 * the image, and "up" follows the file or the shape of the data
 * (renderer/data/default_view/README.md). Reads at most 2 million samples, on this thread. The
 * result depends on the volume alone. If the samples give no result (all samples are equal, or
 * memory runs out), the view equals that of sp_view_init(). Thread-safe; never fails. */
SP_API void sp_view_choose(struct sp_view *view, const struct sp_volume *volume, const char *id);

/* Returns a layer of this type with default values; the value of a surface is NaN, not set yet.
 * Thread-safe. */
SP_API struct sp_layer sp_layer_default(enum sp_layer_type type);

/* Writes the transfer function of a channel of the view. `info` describes the volume that the
 * channel shows. If the channel has no points, the function rises from transparent to `color` and
 * opacity 0.5 within sp_slice_default_window() of `info`; if all samples are equal, everything is
 * transparent. Thread-safe. */
SP_API void sp_channel_function(const struct sp_view *view, const struct sp_layer *channel,
                                const struct sp_volume_info *info,
                                struct sp_transfer_function *function);

/* True if a visible layer of the view is a channel. Thread-safe. */
SP_API bool sp_view_has_channels(const struct sp_view *view);

/* True for the modes that show one number of the values along a ray. Thread-safe. */
static inline bool sp_compositing_is_projection(enum sp_compositing mode) {
    return mode >= SP_COMPOSITE_MAXIMUM;
}

/* Computes centre and width of the window of the view's projection. A number that is set in
 * `compositing` is used unchanged. A number that is NaN is chosen for the volume:
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

/* True if the view draws slices in the image; always false for a projection. Thread-safe. */
SP_API bool sp_view_draws_slices(const struct sp_view *view);

/* True if all fields have equal values. Lists are compared up to their counts, and names up to
 * their ends. All fields of a layer or an edit are compared, whatever its type is. NaN equals NaN;
 * 0 and -0 differ. Do not compare views by their bytes: padding and unused entries have any value.
 * Counts must be within their limits. Thread-safe. */
SP_API bool sp_view_equal(const struct sp_view *a, const struct sp_view *b);
/* Like sp_view_equal(), for two transfer functions. Thread-safe. */
SP_API bool sp_transfer_function_equal(const struct sp_transfer_function *a,
                                       const struct sp_transfer_function *b);

/* True if the two views give the same image, although they may differ in slices that are not
 * drawn in it. Thread-safe. */
SP_API bool sp_view_is_same_image(const struct sp_view *a, const struct sp_view *b);

/* True if view->filter has only the values that sp_view_init() sets. Thread-safe. */
SP_API bool sp_view_has_default_filter(const struct sp_view *view);

/* Checks every range above, and the camera. On failure the code is SP_ERR_INVALID, and err->place
 * is the JSON pointer of the field. The renderer checks what its backend supports
 * (sp_renderer_supports()). Thread-safe. */
SP_API bool sp_view_validate(const struct sp_view *view, struct sp_error *err);

/* True if the volume has the data that the view's visible layers without an id show, and a grid of
 * samples if the view has edits or draws slices in the image. SP_ERR_INVALID; err->place is the
 * JSON pointer. The view must be valid. Thread-safe. */
SP_API bool sp_view_fits(const struct sp_view *view, const struct sp_volume_info *info,
                         struct sp_error *err);
/* Like sp_view_fits(), for one layer and the volume that the layer shows. Thread-safe. */
SP_API bool sp_view_layer_fits(const struct sp_view *view, uint32_t layer,
                               const struct sp_volume_info *info, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
