/* SPDX-License-Identifier: Apache-2.0 */
#include "surface/points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "surface/patch.h"
#include "surface/window.h"
#include "volume/grid.h"

void sp_surface_points_finish(struct sp_surface_points *points) {
    free(points->blocks);
    free(points->at[0]); /* one allocation holds all arrays */
    *points = (struct sp_surface_points){ 0 };
}

enum { ARRAYS = 10 }; /* of 16 bits per point */

static uint64_t array_length(uint64_t count) {
    return count + SURFACE_POINTS_BEYOND;
}

static uint64_t bytes_of(uint64_t count, uint64_t blocks) {
    return array_length(count) * ARRAYS * sizeof(uint16_t) +
           blocks * sizeof(struct sp_surface_block);
}

uint64_t sp_surface_points_bytes(const struct sp_surface_points *points) {
    return points->blocks ? bytes_of(points->count, points->block_count) : 0;
}

enum { SPLIT_MAX = 4, PIECES_MAX = SPLIT_MAX * SPLIT_MAX * SURFACE_PATCHES_MAX };

struct extraction {
    const struct sp_surface_job *job;
    struct sp_surface_points *points;
    struct sp_mat3 to_world; /* gradient along the axes → world */
    double unit;             /* edge of a cube with a cell's volume, world units */
};

/* The cells of a block that the surface crosses: bit x of cells[z][y], and which corners are
 * inside. */
static void find_cells(const struct sp_surface_window *window,
                       uint8_t cells[SURFACE_BLOCK][SURFACE_BLOCK]) {
    uint16_t in[SURFACE_BLOCK + 1][SURFACE_BLOCK + 1], finite[SURFACE_BLOCK + 1][SURFACE_BLOCK + 1];
    for (int z = 0; z <= SURFACE_BLOCK; z++)
        for (int y = 0; y <= SURFACE_BLOCK; y++) {
            const float *row = &window->f[z + 1][y + 1][1];
            unsigned a = 0, b = 0;
            for (int x = 0; x <= SURFACE_BLOCK; x++) {
                a |= (unsigned)(row[x] >= 0) << x;
                b |= (unsigned)(fabsf(row[x]) < INFINITY) << x;
            }
            in[z][y] = (uint16_t)a;
            finite[z][y] = (uint16_t)b;
        }
    for (int z = 0; z < SURFACE_BLOCK; z++)
        for (int y = 0; y < SURFACE_BLOCK; y++) {
            unsigned any = in[z][y] | in[z][y + 1] | in[z + 1][y] | in[z + 1][y + 1];
            unsigned all = in[z][y] & in[z][y + 1] & in[z + 1][y] & in[z + 1][y + 1];
            unsigned good =
                finite[z][y] & finite[z][y + 1] & finite[z + 1][y] & finite[z + 1][y + 1];
            cells[z][y] = (uint8_t)((any | any >> 1) & ~(all & all >> 1) & good & good >> 1);
        }
}

static void read_corners(const struct sp_surface_window *window, int x, int y, int z, float f[8]) {
    for (int c = 0; c < 8; c++)
        f[c] = window->f[z + 1 + (c >> 2)][y + 1 + (c >> 1 & 1)][x + 1 + (c & 1)];
}

static unsigned inside_corners(const float f[8]) {
    unsigned inside = 0;
    for (int c = 0; c < 8; c++)
        inside |= (unsigned)(f[c] >= 0) << c;
    return inside;
}

/* Interpolates the corners of part i of a cell that is split. */
static void split_corners(const float f[8], const uint8_t split[3], const int i[3], float out[8]) {
    for (int c = 0; c < 8; c++) {
        float share[3], sum = 0;
        for (int a = 0; a < 3; a++)
            share[a] = (float)(i[a] + (c >> a & 1)) / (float)split[a];
        for (int k = 0; k < 8; k++) {
            float weight = 1;
            for (int a = 0; a < 3; a++)
                weight *= k >> a & 1 ? share[a] : 1 - share[a];
            sum += weight * f[k];
        }
        out[c] = sum;
    }
}

/* Finds the pieces of a cell that the surface crosses, in each of the parts that it is split into.
 * out: NULL = they are only counted. Returns their number. */
static int find_pieces(const float f[8], const uint8_t split[3],
                       struct sp_surface_patch out[PIECES_MAX]) {
    const int parts = split[0] * split[1] * split[2];
    int count = 0;
    for (int p = 0; p < parts; p++) {
        const int i[3] = { p % split[0], p / split[0] % split[1], p / split[0] / split[1] };
        float own[8];
        if (parts > 1)
            split_corners(f, split, i, own);
        const float *corners = parts > 1 ? own : f;
        const unsigned inside = inside_corners(corners);
        if (inside == 0 || inside == 255)
            continue;
        if (!out) {
            count += sp_surface_patch_count(inside);
            continue;
        }
        int more = sp_surface_patches(corners, out + count);
        for (int k = count; k < count + more; k++)
            for (int a = 0; a < 3; a++) {
                out[k].at[a] = ((float)i[a] + out[k].at[a]) / (float)split[a];
                out[k].area[a] *= (float)split[a] / (float)parts;
            }
        count += more;
    }
    return count;
}

/* Counts the points of the blocks. */
static void count_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct extraction *e = user;
    (void)worker;
    for (size_t b = begin; b < end && !sp_interrupt_is_cancelled(&e->job->interrupt); b++) {
        struct sp_surface_window window;
        struct sp_surface_block *block = &e->points->blocks[b];
        uint8_t cells[SURFACE_BLOCK][SURFACE_BLOCK];
        sp_surface_window_read(&window, e->job->volume, e->job->value, block->corner);
        find_cells(&window, cells);
        block->count = 0;
        for (int z = 0; z < SURFACE_BLOCK; z++)
            for (int y = 0; y < SURFACE_BLOCK; y++)
                for (unsigned left = cells[z][y]; left; left &= left - 1) {
                    float f[8];
                    read_corners(&window, __builtin_ctz(left), y, z, f);
                    block->count += (uint32_t)find_pieces(f, e->points->split, NULL);
                }
    }
}

static int16_t signed_steps(float x, float steps) {
    float scaled = x * steps;
    return (int16_t)lrintf(scaled < -32767 ? -32767 : scaled > 32767 ? 32767 : scaled);
}

/* The gradient at a place in a cell, and how it changes, along the axes [per world unit]. */
struct derivatives {
    float slope[3], bend[3][3];
};

static void find_derivatives(const struct sp_surface_window *window, const int cell[3],
                             const float at[3], struct derivatives *out) {
    *out = (struct derivatives){ 0 };
    for (int c = 0; c < 8; c++) {
        const int place[3] = { cell[0] + (c & 1), cell[1] + (c >> 1 & 1), cell[2] + (c >> 2) };
        float slope[3], weight[3], change[3];
        sp_surface_window_slope(window, place[0], place[1], place[2], slope);
        for (int a = 0; a < 3; a++) {
            weight[a] = c >> a & 1 ? at[a] : 1 - at[a];
            change[a] = (c >> a & 1 ? 1 : -1) / window->gap[a][cell[a] + 1];
        }
        for (int b = 0; b < 3; b++) {
            out->slope[b] += weight[0] * weight[1] * weight[2] * slope[b];
            for (int a = 0; a < 3; a++)
                out->bend[a][b] += change[a] * weight[(a + 1) % 3] * weight[(a + 2) % 3] * slope[b];
        }
    }
}

/* Unit gradient in world space; 0 = there is none. Returns the length of the gradient. */
static double find_normal(const struct extraction *e, const struct derivatives *d,
                          struct sp_vec3 *normal) {
    const float *s = d->slope;
    float largest = fmaxf(fabsf(s[0]), fmaxf(fabsf(s[1]), fabsf(s[2])));
    *normal = (struct sp_vec3){ { 0 } };
    if (!(largest > 0 && largest < INFINITY))
        return 0;
    for (int a = 0; a < 3; a++)
        normal->v[a] = (double)(s[a] / largest);
    *normal = sp_mat3_apply(&e->to_world, *normal);
    double length = sp_vec3_length(*normal);
    *normal = sp_vec3_normalize(*normal);
    return length * (double)largest;
}

/* The mean distance of a disc from the surface, for a kernel of one voxel: ½·Σ kᵀ H k/|∇f| over the
 * columns k of the flat kernel. Along the normal [cells]. */
static float find_bend(const struct extraction *e, const struct sp_surface_window *window,
                       const int cell[3], const struct derivatives *d, double length) {
    const float most = 0.5f; /* noise and edges bend more than a parabola describes */
    double size[3], q[3], square = 0, sum = 0;
    for (int a = 0; a < 3; a++) {
        size[a] = (double)window->gap[a][cell[a] + 1] / e->points->split[a];
        q[a] = size[a] * (double)d->slope[a];
        square += q[a] * q[a];
    }
    for (int a = 0; a < 3; a++) {
        double k[3];
        for (int b = 0; b < 3; b++)
            k[b] = size[b] * ((a == b) - q[a] * q[b] / square);
        for (int b = 0; b < 3; b++)
            for (int c = 0; c < 3; c++)
                sum += k[b] * k[c] * (double)d->bend[b][c];
    }
    float bend = (float)(-0.5 * sum / length / e->unit);
    return bend > most ? most : bend > -most ? bend : -most;
}

static void write_point(const struct extraction *e, const struct sp_surface_window *window,
                        struct sp_surface_block *block, uint64_t to, const int cell[3],
                        const struct sp_surface_patch *patch) {
    const struct sp_surface_points *points = e->points;
    struct derivatives d;
    struct sp_vec3 normal;
    find_derivatives(window, cell, patch->at, &d);
    double length = find_normal(e, &d, &normal);
    float bend = length > 0 ? find_bend(e, window, cell, &d, length) : 0;
    points->bend[to] = signed_steps(bend, SURFACE_BEND_STEPS);
    for (int a = 0; a < 3; a++) {
        long at = lrintf(((float)cell[a] + patch->at[a]) * SURFACE_PLACE_STEPS);
        uint16_t place = (uint16_t)(at > UINT16_MAX ? UINT16_MAX : at);
        points->at[a][to] = place;
        points->area[a][to] = signed_steps(patch->area[a], SURFACE_AREA_STEPS);
        points->normal[a][to] = signed_steps((float)normal.v[a], SURFACE_NORMAL_STEPS);
        block->low[a] = place < block->low[a] ? place : block->low[a];
        block->high[a] = place > block->high[a] ? place : block->high[a];
    }
}

static void fill_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct extraction *e = user;
    (void)worker;
    for (size_t b = begin; b < end && !sp_interrupt_is_cancelled(&e->job->interrupt); b++) {
        struct sp_surface_window window;
        struct sp_surface_block *block = &e->points->blocks[b];
        uint8_t cells[SURFACE_BLOCK][SURFACE_BLOCK];
        uint64_t to = block->first;
        sp_surface_window_read(&window, e->job->volume, e->job->value, block->corner);
        find_cells(&window, cells);
        for (int a = 0; a < 3; a++)
            block->low[a] = UINT16_MAX;
        for (int z = 0; z < SURFACE_BLOCK; z++)
            for (int y = 0; y < SURFACE_BLOCK; y++)
                for (unsigned left = cells[z][y]; left; left &= left - 1) {
                    const int cell[3] = { __builtin_ctz(left), y, z };
                    struct sp_surface_patch patches[PIECES_MAX];
                    float f[8];
                    read_corners(&window, cell[0], y, z, f);
                    int count = find_pieces(f, e->points->split, patches);
                    for (int p = 0; p < count; p++)
                        write_point(e, &window, block, to++, cell, &patches[p]);
                }
    }
}

/* Lists the blocks whose range has the value. */
static bool list_blocks(struct sp_surface_points *points, const struct sp_surface_ranges *ranges,
                        double value) {
    uint64_t all = (uint64_t)ranges->blocks[0] * ranges->blocks[1] * ranges->blocks[2], n = 0;
    for (int pass = 0; pass < 2; pass++) {
        n = 0;
        for (uint64_t b = 0; b < all; b++) {
            const float *range = ranges->range[b];
            if (!((double)range[0] <= value && value <= (double)range[1]))
                continue;
            if (pass) {
                struct sp_surface_block *block = &points->blocks[n];
                *block = (struct sp_surface_block){ 0 };
                block->corner[0] = (uint32_t)(b % ranges->blocks[0]) * SURFACE_BLOCK;
                block->corner[1] =
                    (uint32_t)(b / ranges->blocks[0] % ranges->blocks[1]) * SURFACE_BLOCK;
                block->corner[2] =
                    (uint32_t)(b / ranges->blocks[0] / ranges->blocks[1]) * SURFACE_BLOCK;
            }
            n++;
        }
        if (!pass && !(points->blocks = malloc((n ? n : 1) * sizeof *points->blocks)))
            return false;
    }
    points->block_count = (uint32_t)n;
    return true;
}

/* Drops empty blocks, and numbers the points of the others. */
static void number_points(struct sp_surface_points *points) {
    uint32_t kept = 0;
    points->count = 0;
    for (uint32_t b = 0; b < points->block_count; b++) {
        struct sp_surface_block *block = &points->blocks[kept];
        if (!points->blocks[b].count)
            continue;
        *block = points->blocks[b];
        block->first = points->count;
        points->count += block->count;
        kept++;
    }
    points->block_count = kept;
}

static bool allocate(struct sp_surface_points *points) {
    uint64_t length = array_length(points->count);
    uint16_t *all = calloc(length * ARRAYS, sizeof *all);
    for (int a = 0; all && a < 3; a++) {
        points->at[a] = all + length * (uint64_t)a;
        points->area[a] = (int16_t *)all + length * (uint64_t)(3 + a);
        points->normal[a] = (int16_t *)all + length * (uint64_t)(6 + a);
    }
    points->bend = all ? (int16_t *)all + length * 9 : NULL;
    return all;
}

/* Cells that are longer than wide are split into nearly even parts: kernels as long as they are
 * would stick out of curved surfaces. */
static void choose_split(struct sp_surface_points *points, const struct sp_grid *grid) {
    double least = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    for (int a = 0; a < 3; a++)
        points->split[a] = (uint8_t)fmin(rint(grid->spacing[a] / least), SPLIT_MAX);
}

static bool fail(struct sp_surface_points *points, enum sp_code code, struct sp_error *err) {
    sp_surface_points_finish(points);
    return code == SP_ERR_CANCELLED
               ? sp_fail(err, code, "", "cancelled")
               : sp_fail(err, code, "", "out of memory for the points of a surface");
}

bool sp_surface_points_init(struct sp_surface_points *points, const struct sp_surface_job *job,
                            const struct sp_surface_ranges *ranges, uint64_t bytes_max,
                            struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    struct extraction e = { .job = job, .points = points };
    struct sp_mat3 direction;
    double det;
    *points = (struct sp_surface_points){ 0 };
    choose_split(points, grid);
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            direction.m[r][a] = grid->direction[r][a];
    direction = sp_mat3_inverse(&direction, &det);
    e.to_world = sp_mat3_transpose(&direction);
    e.unit = cbrt(fabs(det) * grid->spacing[0] * grid->spacing[1] * grid->spacing[2]);
    if (!list_blocks(points, ranges, job->value))
        return fail(points, SP_ERR_MEMORY, err);
    sp_parallel_for(job->pool, points->block_count, 16, count_blocks, &e);
    if (sp_interrupt_is_cancelled(&job->interrupt))
        return fail(points, SP_ERR_CANCELLED, err);
    number_points(points);
    uint64_t bytes = bytes_of(points->count, points->block_count);
    if (bytes > bytes_max) {
        sp_surface_points_finish(points);
        return sp_fail(err, SP_ERR_BUDGET, "",
                       "the points of a surface need %llu bytes of the %llu that may be used",
                       (unsigned long long)bytes, (unsigned long long)bytes_max);
    }
    if (!allocate(points))
        return fail(points, SP_ERR_MEMORY, err);
    sp_parallel_for(job->pool, points->block_count, 16, fill_blocks, &e);
    if (sp_interrupt_is_cancelled(&job->interrupt))
        return fail(points, SP_ERR_CANCELLED, err);
    return true;
}
