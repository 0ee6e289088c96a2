/* SPDX-License-Identifier: Apache-2.0
 *
 * The loop over the elements of a cloud, compiled once per instruction set (base/isa.h).
 */
#ifndef SP_CLOUD_KERNELS_H
#define SP_CLOUD_KERNELS_H

#include <math.h>

#include "base/isa.h"
#include "classify/transfer.h"
#include "draw/layers/cloud/tree.h"
#include "draw/layers/splat_list/kernels.h"
#include "sp/elements.h"

/* Variance that the low-pass filter adds to trained Gaussians [px²] (Kerbl et al. 2023). */
#define SP_CLOUD_LOWPASS2 0.3f
/* Largest red, green and blue of a Gaussian, so that no light is infinite. */
#define SP_CLOUD_COLOR_MAX 1e4f

enum { SP_CLOUD_PARTS_MAX = 12 };

/* A copy of a chosen point. It occupies one cache line; reading the arrays would touch four. */
struct sp_cloud_record {
    _Alignas(64) float position[3]; /* all fields as in struct sp_elements */
    float factor[6], value, volume;
    float color; /* sp_cloud_color_number(), if the cloud has other numbers for colours */
};

_Static_assert(sizeof(struct sp_cloud_record) == 64, "one line of the cache");

/* A layer of points or Gaussians in one frame. */
struct sp_cloud {
    const struct sp_elements *elements;
    /* Merged points have the numbers from elements->shape.count on. NULL = no merged points. */
    const struct sp_cloud_tree *tree;
    /* Copies of the chosen points, in no particular order. With records, the number of a point is
     * its index here, and merged points are numbered as above. NULL = the number of a point is its
     * index in `elements`. */
    const struct sp_cloud_record *records;
    /* Gaussians: the splats of the whole image; the number of an element is then its index here.
     * NULL = not set up yet. */
    const struct sp_voxel_record *splats;
    /* u = place·position + offset, and K = place·L times `size` [units of the frame] */
    float place[3][3], offset[3];
    float size;
    float opacity; /* gaussians: factor */
    bool is_normalised;
    bool is_orthographic;
    float eye[3]; /* eye in the coordinates of the data; orthographic: unit direction of view */
    const struct sp_pieces *pieces; /* points: the transfer function, relative to `base` */
    float base;
    /* Points: other numbers that give the colours, by element: one number, or the length of a
     * vector. A number n has the colour of the value (n − color_low)·color_scale + color_first,
     * relative to `base`. Both NULL = the values give the colours. */
    const float *color_values;
    const float (*color_vectors)[3];
    const float *merged_colors; /* the same by merged point (colors.h) */
    uint64_t merged_colors_id;  /* serial number, unique in the cache */
    float color_low, color_scale, color_first;
    float per_volume; /* points: converts volumes from [world unit³ of the data] to cells */
    /* Points: each kernel is drawn as this many parts of equal weight, one behind the other. Part p
     * of element n has the number parts·n + p. */
    uint32_t parts;
    float part_at[SP_CLOUD_PARTS_MAX]; /* depth of each part [deviations of the kernel's depth] */
    float part_deviation; /* deviation of a part's depth [deviations of the kernel's depth] */
};

/* Pointers to the data of an element. */
struct sp_cloud_element {
    const float *position, *factor;
    const float *value;  /* of points; opacity of Gaussians */
    const float *volume; /* of points */
};

static inline struct sp_cloud_element sp_cloud_element_at(const struct sp_cloud *cloud,
                                                          uint32_t number) {
    const struct sp_elements *e = cloud->elements;
    if (number >= e->shape.count) {
        const struct sp_cloud_node *node = &cloud->tree->nodes[number - e->shape.count];
        return (struct sp_cloud_element){ node->position, node->factor, &node->value,
                                          &node->volume };
    }
    if (cloud->records) {
        const struct sp_cloud_record *record = &cloud->records[number];
        return (struct sp_cloud_element){ record->position, record->factor, &record->value,
                                          &record->volume };
    }
    return (struct sp_cloud_element){ e->positions[number], e->factors[number],
                                      e->values ? &e->values[number] : &e->opacities[number],
                                      e->volumes ? &e->volumes[number] : NULL };
}

static inline bool sp_cloud_has_colors(const struct sp_cloud *cloud) {
    return cloud->color_values || cloud->color_vectors;
}

/* Returns the number that gives the colour of a point or merged point. */
static inline float sp_cloud_color_number(const struct sp_cloud *cloud, uint32_t number) {
    const uint32_t count = cloud->elements->shape.count;
    if (number >= count)
        return cloud->merged_colors[number - count];
    if (cloud->color_values)
        return cloud->color_values[number];
    const float *v = cloud->color_vectors[number];
    return sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* Sets up the splats of elements[count] of the cloud `from` (struct sp_cloud), in order. Leaves out
 * splats that touch none of the rows being drawn, and splats that touch closed tiles only. Returns
 * the number of splats written. */
uint32_t sp_cloud_set_up(const struct sp_voxel_frame *frame, const void *from,
                         const uint32_t *elements, uint32_t count, struct sp_voxel_record *out);

/* Like sp_cloud_set_up(), for Gaussians. */
uint32_t sp_cloud_set_up_gaussians(const struct sp_voxel_frame *frame, const struct sp_cloud *cloud,
                                   const uint32_t *elements, uint32_t count,
                                   struct sp_voxel_record *out);

#endif
