/* SPDX-License-Identifier: Apache-2.0
 *
 * Lines as triangles: tubes of eight sides. Each point of a line has a ring across the line; rings
 * are turned as little as possible from one to the next, and flat caps close the ends.
 */
#ifndef SP_IMPORT_TUBES_H
#define SP_IMPORT_TUBES_H

#include "sp/elements.h"

/* The radius of tubes, as a share of the diameter of what the file has. */
#define IMPORT_TUBE_RADIUS (1.0 / 400)

struct import_lines {
    uint32_t count;
    const uint32_t *counts; /* points of each line; lines of less than two are not drawn */
    const float (*positions)[3];
    const float (*colors)[4];
};

/* Adds the vertices and triangles that the tubes have. */
void import_tubes_count(const struct import_lines *lines, uint64_t *vertices, uint64_t *triangles);

/* Writes the tubes from that vertex and triangle on. Points that are not finite stay so. */
void import_tubes_fill(const struct import_lines *lines, double radius,
                       const struct sp_elements *elements, uint32_t vertex, uint32_t triangle);

#endif
