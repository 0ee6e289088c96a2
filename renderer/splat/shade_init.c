/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/shade.h"

#include <math.h>

#define GLINT_WIDTH_MIN                                                                            \
    (1.0 /                                                                                         \
     128) /* Microflakes are stored in 8 bits, which cannot represent a narrower distribution. */

void sp_shade_init(struct sp_shade *shade, const struct sp_camera_transform *camera,
                   const struct sp_shading *shading) {
    *shade = (struct sp_shade){ .ambient = (float)shading->ambient,
                                .diffuse = (float)shading->diffuse,
                                .specular = (float)shading->specular,
                                .exponent = (float)shading->exponent,
                                .light_count = (int)shading->light_count };
    shade->glint_width = (float)fmax(1 / shading->exponent, GLINT_WIDTH_MIN);
    shade->glint_gain = (float)(0.5 * shading->exponent * log2(3) - log2(shading->exponent + 1));
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
            shade->lights[i].world[c] =
                (float)(camera->w.m[0][c] * d.v[0] + camera->w.m[1][c] * d.v[1] +
                        camera->w.m[2][c] * d.v[2]);
            shade->lights[i].color[c] = light->color[c];
        }
    }
}
