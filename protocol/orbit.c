/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/orbit.h"

#include <math.h>
#include <string.h>

static const double degree = M_PI / 180;
/* Beyond this elevation, up is too close to the direction of view to be up. */
static const double pole_deg = 89.9;

struct axes {
    double up[3], front[3], right[3]; /* orthonormal; right as seen by an eye at the front */
};

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* out = a·A + b·B; out may be A or B. */
static void combine(double a, const double A[3], double b, const double B[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a * A[i] + b * B[i];
}

static void normalize(double v[3]) {
    double length = hypot(hypot(v[0], v[1]), v[2]);
    for (int i = 0; i < 3; i++)
        v[i] /= length;
}

/* Exact for multiples of 90 degrees, so that such views have round numbers. */
static void compute_sine(double angle_deg, double *sine, double *cosine) {
    double quarters = angle_deg / 90;
    if (quarters == floor(quarters)) {
        int q = (int)fmod(fmod(quarters, 4) + 4, 4);
        *sine = q == 1 ? 1 : q == 3 ? -1 : 0;
        *cosine = q == 0 ? 1 : q == 2 ? -1 : 0;
    } else {
        *sine = sin(angle_deg * degree);
        *cosine = cos(angle_deg * degree);
    }
}

static struct axes compute_axes(const struct sp_camera *defaults) {
    struct axes axes;
    double away[3];
    memcpy(axes.up, defaults->up, sizeof axes.up);
    normalize(axes.up);
    combine(1, defaults->position, -1, defaults->target, away);
    combine(1, away, -dot(away, axes.up), axes.up, away);
    int most = 0;
    for (int i = 1; i < 3; i++)
        if (fabs(away[i]) > fabs(away[most]))
            most = i;
    double front[3] = { 0 };
    front[most] = away[most] < 0 ? -1 : 1;
    combine(1, front, -dot(front, axes.up), axes.up, axes.front);
    normalize(axes.front);
    cross(axes.up, axes.front, axes.right);
    return axes;
}

/* The direction from the target to the eye, and the vectors of the image without roll. */
struct frame {
    double away[3], above[3], aside[3];
};

static struct frame compute_frame(const struct axes *axes, double azimuth, double elevation) {
    double sine, cosine, horizontal[3];
    struct frame frame;
    compute_sine(azimuth, &sine, &cosine);
    combine(cosine, axes->front, sine, axes->right, horizontal);
    compute_sine(elevation, &sine, &cosine);
    combine(cosine, horizontal, sine, axes->up, frame.away);
    combine(-sine, horizontal, cosine, axes->up, frame.above);
    cross(frame.above, frame.away, frame.aside);
    return frame;
}

struct proto_orbit proto_orbit_of(const struct sp_camera *camera,
                                  const struct sp_camera *defaults) {
    struct axes axes = compute_axes(defaults);
    struct proto_orbit orbit;
    double away[3], towards[3];
    combine(1, camera->position, -1, camera->target, away);
    double rise = dot(away, axes.up);
    double horizontal = hypot(dot(away, axes.front), dot(away, axes.right));
    double elevation = atan2(rise, horizontal) / degree;
    memcpy(towards, away, sizeof towards);
    if (fabs(elevation) > pole_deg) /* there the top of the image tells the azimuth */
        combine(rise > 0 ? -1 : 1, camera->up, 0, camera->up, towards);
    orbit.value[PROTO_ORBIT_AZIMUTH] =
        atan2(dot(towards, axes.right), dot(towards, axes.front)) / degree;
    orbit.value[PROTO_ORBIT_ELEVATION] = elevation;
    orbit.value[PROTO_ORBIT_DISTANCE] = hypot(rise, horizontal);
    struct frame frame = compute_frame(&axes, orbit.value[PROTO_ORBIT_AZIMUTH], elevation);
    orbit.value[PROTO_ORBIT_ROLL] =
        atan2(-dot(camera->up, frame.aside), dot(camera->up, frame.above)) / degree;
    return orbit;
}

void proto_orbit_place(const struct proto_orbit *orbit, const struct sp_camera *defaults,
                       struct sp_camera *camera) {
    struct axes axes = compute_axes(defaults);
    double elevation = orbit->value[PROTO_ORBIT_ELEVATION], sine, cosine;
    struct frame frame = compute_frame(&axes, orbit->value[PROTO_ORBIT_AZIMUTH], elevation);
    combine(1, camera->target, orbit->value[PROTO_ORBIT_DISTANCE], frame.away, camera->position);
    compute_sine(orbit->value[PROTO_ORBIT_ROLL], &sine, &cosine);
    if (fabs(orbit->value[PROTO_ORBIT_ROLL]) < 1e-9 && fabs(elevation) <= pole_deg)
        memcpy(camera->up, defaults->up, sizeof camera->up);
    else
        combine(cosine, frame.above, -sine, frame.aside, camera->up);
    for (int i = 0; i < 3; i++) { /* -0 becomes 0: equal views have equal bytes */
        camera->position[i] += 0.0;
        camera->up[i] += 0.0;
    }
}
