/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/shade.h"

#include "splat/exp2.h"

void sp_shade_init(struct sp_shade *shade, const struct sp_camera_frame *camera,
                   const struct sp_shading *shading) {
    *shade = (struct sp_shade){ .ambient = (float)shading->ambient,
                                .diffuse = (float)shading->diffuse,
                                .specular = (float)shading->specular,
                                .exponent = (float)shading->exponent,
                                .light_count = (int)shading->light_count };
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            shade->to_camera[r][c] = (float)camera->w.m[r][c];
    for (int i = 0; i < shade->light_count; i++) {
        const struct sp_light *light = &shading->lights[i];
        const double *p = light->direction;
        double largest = fmax(fabs(p[0]), fmax(fabs(p[1]), fabs(p[2])));
        struct sp_vec3 d = sp_vec3_normalize(sp_vec3_scale(sp_vec3_from(p), 1 / largest));
        if (light->space == SP_LIGHT_WORLD)
            d = sp_mat3_apply(&camera->w, d);
        else /* x right, y up, z towards the viewer */
            d = (struct sp_vec3){ { d.v[0], -d.v[1], -d.v[2] } };
        for (int c = 0; c < 3; c++) {
            shade->lights[i].direction[c] = (float)d.v[c];
            shade->lights[i].color[c] = light->color[c];
        }
    }
}

static float dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void sp_shade_direction(const struct sp_shade *shade, const float world[3], const float to_eye[3],
                        float color[3]) {
    float n[3], lit[3], shine[3] = { 0, 0, 0 };
    for (int r = 0; r < 3; r++) {
        n[r] = dot(shade->to_camera[r], world);
        lit[r] = shade->ambient;
    }
    int has_side = world[0] != 0 || world[1] != 0 || world[2] != 0;
    for (int i = 0; i < shade->light_count; i++) {
        const float *l = shade->lights[i].direction, *strength = shade->lights[i].color;
        float facing = has_side ? fabsf(dot(n, l)) : 1, glint = 0;
        float h[3] = { l[0] + to_eye[0], l[1] + to_eye[1], l[2] + to_eye[2] };
        float length2 = dot(h, h), along = fabsf(dot(n, h));
        if (has_side && length2 > 1e-12f && along > 1e-6f)
            glint = sp_exp2(shade->exponent * sp_log2(along * along / length2) * 0.5f);
        for (int c = 0; c < 3; c++) {
            lit[c] += shade->diffuse * facing * strength[c];
            shine[c] += shade->specular * glint * strength[c];
        }
    }
    for (int c = 0; c < 3; c++)
        color[c] = color[c] * lit[c] + shine[c];
}

void sp_shade_apply(const struct sp_shade *shade, uint32_t packed_gradient, const float to_eye[3],
                    float color[3]) {
    float world[3];
    sp_gradient_unpack(packed_gradient, world);
    sp_shade_direction(shade, world, to_eye, color);
}
