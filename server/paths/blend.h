/* SPDX-License-Identifier: Apache-2.0
 *
 * Interpolates the members of a view from a (u = 0) to b (u = 1). Both views must be valid. The
 * result is bit-equal to `a` at u = 0 and to `b` at u = 1.
 *
 *   numbers, colours   linear
 *   names              a until u = 1
 *   camera             moves on an arc around its target: the target is linear, the orientation
 *                      turns at constant speed around one axis, the shorter way (slerp), and the
 *                      distance is linear in its logarithm, as are height and near plane
 *   transfer function  a function of value: at each value the linear mean of both. Both are linear
 *                      between points, so that the points of both together give it exactly; so does
 *                      the gradient's, where no points mean 1 everywhere
 *   directions         turn as the camera does; opposite ones, which have no way between them, and
 *                      lists of different lengths, are a until u = 1
 *   c_min, c_max       a until u = 1 if one of them is automatic
 *   window, zero, absorption
 *                      of a projection: a until u = 1 if the modes differ, or one of them is
 *                      automatic; the window also if one of both has no absorption, which changes
 *                      its unit
 *   time step          linear, rounded to the nearest step
 *   edits              a until u = 1: each step would change the volume
 *   layers             a until u = 1 if their number or their types differ; an infinite flatness is
 *                      a until u = 1; transforms move as blend_transform.h says; the points of a
 *                      channel are a until u = 1 if their number differs
 */
#ifndef SRV_PATHS_BLEND_H
#define SRV_PATHS_BLEND_H

#include "sp/view.h"

void srv_blend_camera(const struct sp_camera *a, const struct sp_camera *b, double u,
                      struct sp_camera *out);
/* Counts the distinct points of both together. A pair with more than SP_TF_POINTS_MAX points or
 * SP_GRADIENT_POINTS_MAX gradient points cannot be blended. */
void srv_blend_count(const struct sp_transfer_function *a, const struct sp_transfer_function *b,
                     unsigned *points, unsigned *gradient);
void srv_blend_transfer_function(const struct sp_transfer_function *a,
                                 const struct sp_transfer_function *b, double u,
                                 struct sp_transfer_function *out);
void srv_blend_filter(const struct sp_filter *a, const struct sp_filter *b, double u,
                      struct sp_filter *out);
void srv_blend_compositing(const struct sp_compositing_options *a,
                           const struct sp_compositing_options *b, double u,
                           struct sp_compositing_options *out);
void srv_blend_shading(const struct sp_shading *a, const struct sp_shading *b, double u,
                       struct sp_shading *out);
void srv_blend_clip(const struct sp_clip *a, const struct sp_clip *b, double u,
                    struct sp_clip *out);
/* Of the members of the view only the layers are read and written. */
void srv_blend_layers(const struct sp_view *a, const struct sp_view *b, double u,
                      struct sp_view *out);
void srv_blend_slices(const struct sp_slices *a, const struct sp_slices *b, double u,
                      struct sp_slices *out);
void srv_blend_time(const struct sp_time *a, const struct sp_time *b, double u,
                    struct sp_time *out);
void srv_blend_background(const float a[4], const float b[4], double u, float out[4]);

#endif
