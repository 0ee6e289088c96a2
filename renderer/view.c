/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/view.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/vec.h"

/* World bounds of the voxels' cells: half a voxel around the outermost samples. */
static void find_sphere(const struct sp_grid *grid, struct sp_vec3 *centre, double *radius) {
    double half[3], middle[3];
    for (int a = 0; a < 3; a++) {
        half[a] = 0.5 * grid->dims[a] * grid->spacing[a];
        middle[a] = 0.5 * (grid->dims[a] - 1.0) * grid->spacing[a];
    }
    *radius = 0;
    for (int r = 0; r < 3; r++) {
        centre->v[r] = grid->origin[r];
        for (int a = 0; a < 3; a++)
            centre->v[r] += grid->direction[r][a] * middle[a];
    }
    for (int corner = 0; corner < 4; corner++) { /* the other four lie opposite */
        struct sp_vec3 p;
        for (int r = 0; r < 3; r++)
            p.v[r] = grid->direction[r][0] * half[0] +
                     grid->direction[r][1] * (corner & 1 ? -half[1] : half[1]) +
                     grid->direction[r][2] * (corner & 2 ? -half[2] : half[2]);
        *radius = fmax(*radius, sp_vec3_length(p));
    }
}

static void init_camera(struct sp_camera *camera, const struct sp_grid *grid, double smallest) {
    static const double from[3] = { 0.45, -0.82, 0.35 };
    struct sp_vec3 centre;
    double radius;
    find_sphere(grid, &centre, &radius);
    *camera = (struct sp_camera){ .projection = SP_PERSPECTIVE,
                                  .up = { 0, 0, 1 },
                                  .fov_y = 30,
                                  .height = 2 * radius,
                                  .near = 0.1 * smallest };
    /* The sphere around the volume just fits, so that it stays in the picture when turned. */
    double distance = radius / sin(0.5 * camera->fov_y * M_PI / 180);
    struct sp_vec3 away = sp_vec3_normalize(sp_vec3_from(from));
    for (int i = 0; i < 3; i++) {
        camera->target[i] = centre.v[i];
        camera->position[i] = centre.v[i] + distance * away.v[i];
    }
}

/* Splits bins [first, 256) in two at the bin that separates their means best (Otsu 1979); returns
 * the first bin of the upper class. `power` < 1 lifts small classes beside a large one. */
static int split_histogram(const double *weight, int first) {
    double sum = 0, moment = 0, below = 0, below_moment = 0, best = -1;
    int cut = first + 1;
    for (int b = first; b < SP_HISTOGRAM_BINS; b++) {
        sum += weight[b];
        moment += weight[b] * b;
    }
    for (int b = first; b + 1 < SP_HISTOGRAM_BINS; b++) {
        below += weight[b];
        below_moment += weight[b] * b;
        if (below <= 0 || below >= sum)
            continue;
        double gap = below_moment / below - (moment - below_moment) / (sum - below);
        double between = below * (sum - below) * gap * gap;
        if (between > best) {
            best = between;
            cut = b + 1;
        }
    }
    return cut;
}

/* Background is dark and common: it ends where Otsu's threshold puts it, counts damped so that
 * empty space does not decide alone. The rest is split once more into soft and dense matter. */
static void init_transfer_function(struct sp_transfer_function *tf,
                                   const struct sp_volume_info *info, double smallest) {
    static const struct {
        float
            at; /* 0 = where the background ends, 1 = where dense matter begins, 2 = the maximum */
        float color[3], opacity;
    } ramp[] = {
        { 0.0f, { 0.62f, 0.26f, 0.18f }, 0.0f },  { 0.25f, { 0.86f, 0.52f, 0.38f }, 0.035f },
        { 0.8f, { 0.90f, 0.62f, 0.46f }, 0.06f }, { 1.0f, { 0.97f, 0.88f, 0.72f }, 0.22f },
        { 1.3f, { 1.00f, 0.96f, 0.88f }, 0.50f }, { 2.0f, { 1.00f, 1.00f, 1.00f }, 0.80f },
    };
    enum { RAMP = sizeof ramp / sizeof ramp[0] };
    double weight[SP_HISTOGRAM_BINS];
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
        weight[b] = pow((double)info->histogram[b], 0.6);
    int soft = split_histogram(weight, 0), dense = split_histogram(weight, soft);
    double low = info->range[0], span = info->range[1] - low;
    double knots[3] = { soft / 256.0, dense / 256.0, 1.0 };
    *tf = (struct sp_transfer_function){ .reference_length = smallest, .order = SP_TF_PRE };
    if (!(span > 0) || !isfinite(span)) { /* one value alone: show it */
        tf->point_count = 1;
        tf->points[0] = (struct sp_tf_point){ info->range[0], { 0.9f, 0.8f, 0.7f }, 0.1f };
        return;
    }
    for (int i = 0; i < RAMP; i++) {
        int k = ramp[i].at < 1 ? 0 : 1;
        double f = ramp[i].at - k;
        double value = low + span * (knots[k] + f * (knots[k + 1] - knots[k]));
        if (tf->point_count && value <= tf->points[tf->point_count - 1].value)
            continue;
        struct sp_tf_point *p = &tf->points[tf->point_count++];
        p->value = value;
        memcpy(p->color, ramp[i].color, sizeof p->color);
        p->opacity = ramp[i].opacity;
    }
}

void sp_view_init(struct sp_view *view, const struct sp_volume_info *info, const char *id) {
    const struct sp_grid *grid = &info->grid;
    double smallest = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    *view = (struct sp_view){
        .size = { 512, 512 },
        .background = { 0, 0, 0, 1 },
        .filter = { .mode = SP_FILTER_ADAPTIVE,
                    .kernel = SP_KERNEL_GAUSSIAN,
                    .sigma = 0.7,
                    .cutoff = 3,
                    .lowpass = 1,
                    .c_min = 0.3,
                    .c_max = NAN },
        .compositing = { SP_COMPOSITE_SHEET, SP_ATTENUATION_EXPONENTIAL, 1 },
        .shading = { .mode = SP_SHADING_PHONG,
                     .ambient = 0.25,
                     .diffuse = 0.8,
                     .specular = 0.25,
                     .exponent = 24,
                     .light_count = 1,
                     .lights = { { { 0.3, 0.5, 1 }, SP_LIGHT_CAMERA, { 1, 1, 1 } } } },
        .primitive = SP_PRIMITIVE_VOLUME,
        .clip = { .box = { { 0, 0, 0 }, { 1, 1, 1 } } },
        .level_of_detail = SP_LOD_AUTO,
    };
    snprintf(view->volume, sizeof view->volume, "%s", id);
    init_camera(&view->camera, grid, smallest);
    init_transfer_function(&view->transfer_function, info, smallest);
}

__attribute__((format(printf, 5, 6))) static bool
check_range(double x, double low, double high, struct sp_error *err, const char *format, ...) {
    if (x >= low && x <= high)
        return true;
    char pointer[SP_ERROR_PLACE];
    va_list args;
    va_start(args, format);
    vsnprintf(pointer, sizeof pointer, format, args);
    va_end(args);
    if (!isfinite(x))
        return sp_fail(err, SP_ERR_INVALID, pointer, "not a finite number");
    if (high >= DBL_MAX)
        return sp_fail(err, SP_ERR_INVALID, pointer, "%g is less than %g", x, low);
    return sp_fail(err, SP_ERR_INVALID, pointer, "%g is outside [%g, %g]", x, low, high);
}

static bool check_finite3(const double v[3], const char *pointer, struct sp_error *err) {
    for (int i = 0; i < 3; i++)
        if (!check_range(v[i], -DBL_MAX, DBL_MAX, err, "%s/%d", pointer, i))
            return false;
    return true;
}

static bool check_positive(double x, const char *pointer, struct sp_error *err) {
    if (isfinite(x) && x > 0)
        return true;
    return sp_fail(err, SP_ERR_INVALID, pointer, "%g is not a finite number above 0", x);
}

static bool check_choice(unsigned value, unsigned last, const char *pointer, struct sp_error *err) {
    return value <= last ||
           sp_fail(err, SP_ERR_INVALID, pointer, "%u is not one of the choices", value);
}

/* A vector without direction; any finite length is fine, whatever its square does. */
static bool is_zero(const double v[3]) {
    return v[0] == 0 && v[1] == 0 && v[2] == 0;
}

static struct sp_vec3 unit_vector(const double v[3]) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    struct sp_vec3 r = { { 0 } };
    if (largest > 0)
        for (int i = 0; i < 3; i++)
            r.v[i] = v[i] / largest;
    return sp_vec3_normalize(r);
}

static bool check_camera(const struct sp_camera *c, struct sp_error *err) {
    if (!check_choice(c->projection, SP_ORTHOGRAPHIC, "/camera/projection", err) ||
        !check_finite3(c->position, "/camera/position", err) ||
        !check_finite3(c->target, "/camera/target", err) ||
        !check_finite3(c->up, "/camera/up", err) ||
        !check_range(c->fov_y, 1, 170, err, "/camera/fov_y") ||
        !check_positive(c->height, "/camera/height", err) ||
        !check_positive(c->near, "/camera/near", err))
        return false;
    double to[3], reach = 0;
    for (int i = 0; i < 3; i++) {
        to[i] = c->target[i] / 4 - c->position[i] / 4;
        reach = fmax(reach, fmax(fabs(c->position[i] / 4), fabs(c->target[i] / 4)));
    }
    struct sp_vec3 forward = unit_vector(to);
    /* Closer than this the direction is rounding noise. */
    double apart = fmax(fabs(to[0]), fmax(fabs(to[1]), fabs(to[2])));
    if (!(apart > 1e-12 * reach))
        return sp_fail(err, SP_ERR_INVALID, "/camera/position",
                       "position and target are the same point; move one of them");
    if (is_zero(c->up))
        return sp_fail(err, SP_ERR_INVALID, "/camera/up", "up is zero; give it a direction");
    if (!(sp_vec3_length(sp_vec3_cross(forward, unit_vector(c->up))) > 1e-6))
        return sp_fail(err, SP_ERR_INVALID, "/camera/up",
                       "up is parallel to the view direction; turn one of them");
    return true;
}

static bool check_transfer_function(const struct sp_transfer_function *tf, struct sp_error *err) {
    if (!check_positive(tf->reference_length, "/transfer_function/reference_length", err) ||
        !check_choice(tf->order, SP_TF_POST, "/transfer_function/order", err) ||
        !check_range(tf->point_count, 1, SP_TF_POINTS_MAX, err, "/transfer_function/points") ||
        !check_range(tf->gradient_count, 0, SP_GRADIENT_POINTS_MAX, err,
                     "/transfer_function/gradient"))
        return false;
    char place[96];
    for (uint32_t i = 0; i < tf->point_count; i++) {
        const struct sp_tf_point *p = &tf->points[i];
        snprintf(place, sizeof place, "/transfer_function/points/%u", i);
        if (!check_range(p->value, -DBL_MAX, DBL_MAX, err, "%s/value", place))
            return false;
        if (i && !(p->value > p[-1].value)) {
            snprintf(place, sizeof place, "/transfer_function/points/%u/value", i);
            return sp_fail(err, SP_ERR_INVALID, place,
                           "%g does not rise above the point before it (%g)", p->value,
                           p[-1].value);
        }
        for (int c = 0; c < 3; c++)
            if (!check_range(p->color[c], 0, 1, err, "%s/color/%d", place, c))
                return false;
        if (!(p->opacity >= 0 && p->opacity < 1)) {
            snprintf(place, sizeof place, "/transfer_function/points/%u/opacity", i);
            return sp_fail(err, SP_ERR_INVALID, place, "%g is outside [0, 1)", p->opacity);
        }
    }
    for (uint32_t i = 0; i < tf->gradient_count; i++) {
        const struct sp_gradient_point *p = &tf->gradient[i];
        snprintf(place, sizeof place, "/transfer_function/gradient/%u", i);
        if (!check_range(p->magnitude, 0, DBL_MAX, err, "%s/magnitude", place) ||
            !check_range(p->scale, 0, 1, err, "%s/scale", place))
            return false;
        if (i && !(p->magnitude > p[-1].magnitude)) {
            snprintf(place, sizeof place, "/transfer_function/gradient/%u/magnitude", i);
            return sp_fail(err, SP_ERR_INVALID, place,
                           "%g does not rise above the point before it (%g)", p->magnitude,
                           p[-1].magnitude);
        }
    }
    return true;
}

static bool check_filter(const struct sp_filter *f, struct sp_error *err) {
    if (!check_choice(f->mode, SP_FILTER_NONE, "/filter/mode", err) ||
        !check_choice(f->kernel, SP_KERNEL_CUBIC, "/filter/kernel", err) ||
        !check_range(f->sigma, 0.3, 2, err, "/filter/sigma") ||
        !check_range(f->cutoff, 1, 6, err, "/filter/cutoff") ||
        !check_range(f->lowpass, 0, 8, err, "/filter/lowpass") ||
        !check_positive(f->c_min, "/filter/c_min", err))
        return false;
    if (isnan(f->c_max))
        return true;
    if (!check_positive(f->c_max, "/filter/c_max", err))
        return false;
    return f->c_min <= f->c_max || sp_fail(err, SP_ERR_INVALID, "/filter/c_min",
                                           "c_min %g is above c_max %g", f->c_min, f->c_max);
}

static bool check_shading(const struct sp_shading *s, struct sp_error *err) {
    if (!check_choice(s->mode, SP_SHADING_PHONG, "/shading/mode", err) ||
        !check_range(s->ambient, 0, 4, err, "/shading/ambient") ||
        !check_range(s->diffuse, 0, 4, err, "/shading/diffuse") ||
        !check_range(s->specular, 0, 4, err, "/shading/specular") ||
        !check_range(s->exponent, 1, 1024, err, "/shading/exponent") ||
        !check_range(s->light_count, 0, SP_LIGHTS_MAX, err, "/shading/lights"))
        return false;
    for (uint32_t i = 0; i < s->light_count; i++) {
        const struct sp_light *l = &s->lights[i];
        char place[64];
        snprintf(place, sizeof place, "/shading/lights/%u/space", i);
        if (!check_choice(l->space, SP_LIGHT_WORLD, place, err))
            return false;
        snprintf(place, sizeof place, "/shading/lights/%u/direction", i);
        if (!check_finite3(l->direction, place, err))
            return false;
        if (is_zero(l->direction))
            return sp_fail(err, SP_ERR_INVALID, place, "the direction is zero");
        for (int c = 0; c < 3; c++)
            if (!check_range(l->color[c], 0, 4, err, "/shading/lights/%u/color/%d", i, c))
                return false;
    }
    return true;
}

static bool check_clip(const struct sp_clip *clip, struct sp_error *err) {
    for (int corner = 0; corner < 2; corner++)
        for (int i = 0; i < 3; i++)
            if (!check_range(clip->box[corner][i], 0, 1, err, "/clip/box/%d/%d", corner, i))
                return false;
    for (int i = 0; i < 3; i++)
        if (clip->box[0][i] > clip->box[1][i]) {
            char place[32];
            snprintf(place, sizeof place, "/clip/box/0/%d", i);
            return sp_fail(err, SP_ERR_INVALID, place, "%g is above the upper corner's %g",
                           clip->box[0][i], clip->box[1][i]);
        }
    if (!check_range(clip->plane_count, 0, SP_CLIP_PLANES_MAX, err, "/clip/planes"))
        return false;
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        char place[48];
        snprintf(place, sizeof place, "/clip/planes/%u/normal", i);
        if (!check_finite3(clip->planes[i].normal, place, err))
            return false;
        if (is_zero(clip->planes[i].normal))
            return sp_fail(err, SP_ERR_INVALID, place, "the normal is zero");
        if (!check_range(clip->planes[i].offset, -DBL_MAX, DBL_MAX, err, "/clip/planes/%u/offset",
                         i))
            return false;
    }
    return true;
}

bool sp_view_validate(const struct sp_view *view, struct sp_error *err) {
    for (int i = 0; i < 2; i++)
        if (!check_range(view->size[i], 1, SP_SIZE_MAX, err, "/size/%d", i))
            return false;
    for (int i = 0; i < 4; i++)
        if (!check_range(view->background[i], 0, 1, err, "/background/%d", i))
            return false;
    if (!memchr(view->volume, 0, sizeof view->volume))
        return sp_fail(err, SP_ERR_INVALID, "/volume", "the id is longer than %d bytes",
                       SP_NAME_BYTES - 1);
    const struct sp_compositing_options *c = &view->compositing;
    return check_camera(&view->camera, err) &&
           check_transfer_function(&view->transfer_function, err) &&
           check_filter(&view->filter, err) &&
           check_choice(c->mode, SP_COMPOSITE_SLAB, "/compositing/mode", err) &&
           check_choice(c->attenuation, SP_ATTENUATION_LINEAR, "/compositing/attenuation", err) &&
           check_range(c->slab, 0.05, 64, err, "/compositing/slab") &&
           check_shading(&view->shading, err) &&
           check_choice(view->primitive, SP_PRIMITIVE_VECTOR, "/primitive/type", err) &&
           check_clip(&view->clip, err) &&
           check_choice(view->level_of_detail, SP_LOD_OFF, "/quality/level_of_detail", err);
}
