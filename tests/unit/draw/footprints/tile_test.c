/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "draw/footprints/bin.h"
#include "draw/footprints/order.h"
#include "draw/footprints/sheet.h"
#include "support/compare.h"

enum { COLUMNS = 5, ROWS = 4, WIDTH = 150, HEIGHT = 117, SPLATS = 3000 };

/* Returns a splat with a random footprint whose box touches the image. */
static struct sp_splat random_splat(uint32_t sheet, float cut) {
    struct sp_splat s = { .sheet = sheet };
    for (;;) {
        double v00 = exp(rand() / (RAND_MAX / 9.0) - 3), v11 = exp(rand() / (RAND_MAX / 9.0) - 3);
        double v01 = sqrt(v00 * v11) * (rand() / (RAND_MAX / 1.98) - 0.99);
        double det = v00 * v11 - v01 * v01, half = 0.5 / log(2) / det;
        double r = sqrt((double)cut * 2 * log(2));
        s.x = (float)(rand() / (RAND_MAX / (WIDTH + 40.0)) - 20);
        s.y = (float)(rand() / (RAND_MAX / (HEIGHT + 40.0)) - 20);
        s.a = (float)(half * v11);
        s.b = (float)(-2 * half * v01);
        s.c = (float)(half * v00);
        s.depth = (float)(rand() / (RAND_MAX / 0.2));
        for (int c = 0; c < 3; c++)
            s.emission[c] = s.depth * (float)(rand() / (double)RAND_MAX);
        double x0 = ceil((double)s.x - r * sqrt(v00) - 0.5),
               x1 = floor((double)s.x + r * sqrt(v00) + 0.5);
        double y0 = ceil((double)s.y - r * sqrt(v11) - 0.5),
               y1 = floor((double)s.y + r * sqrt(v11) + 0.5);
        s.x0 = (int16_t)fmax(0, x0);
        s.x1 = (int16_t)fmin(WIDTH, x1);
        s.y0 = (int16_t)fmax(0, y0);
        s.y1 = (int16_t)fmin(HEIGHT, y1);
        if (s.x0 < s.x1 && s.y0 < s.y1)
            return s;
    }
}

static const struct sp_blend blending = {
    .mode = SP_COMPOSITE_SHEET, .planes = SP_PLANES, .slots = 1, .cut = 6.5f
};

/* A tile of sheets with its own memory. */
static void start_tile(struct sp_tile *tile, int x, int y, const int size[2]) {
    tile->sums = malloc(SP_PLANES * SP_TILE_AREA * sizeof *tile->sums);
    tile->dirty = malloc(sizeof *tile->dirty);
    assert_true(tile->sums);
    assert_true(tile->dirty);
    sp_tile_init(tile, x, y, size, &blending);
}

static void stop_tile(struct sp_tile *tile) {
    free(tile->sums);
    free(tile->dirty);
}

static struct sp_tile_grid make_grid(void) {
    struct sp_tile_grid grid = { .columns = COLUMNS, .rows = ROWS };
    grid.tiles = aligned_alloc(64, COLUMNS * ROWS * sizeof *grid.tiles);
    assert_non_null(grid.tiles);
    for (int r = 0; r < ROWS; r++)
        for (int c = 0; c < COLUMNS; c++)
            start_tile(&grid.tiles[r * COLUMNS + c], c * SP_TILE, r * SP_TILE,
                       (int[2]){ WIDTH, HEIGHT });
    return grid;
}

static void free_grid(struct sp_tile_grid *grid) {
    for (int t = 0; t < COLUMNS * ROWS; t++)
        stop_tile(&grid->tiles[t]);
    free(grid->tiles);
}

struct bench {
    struct sp_bins bins;
    struct sp_splat *records;
};

/* Sorts the records in blocks of 700. */
static struct bench sort(const struct sp_tile_grid *grid, struct sp_splat *records,
                         uint32_t count) {
    struct bench b = { .records = records };
    b.bins.tiles = COLUMNS * ROWS;
    b.bins.blocks = (count + 699) / 700;
    b.bins.capacity = count * COLUMNS * ROWS;
    b.bins.counts = calloc(b.bins.tiles * b.bins.blocks, 4);
    b.bins.first = calloc(b.bins.tiles + 1, 4);
    b.bins.entries = calloc(b.bins.capacity, 4);
    uint64_t total = 0;
    for (uint32_t k = 0; k < b.bins.blocks; k++) {
        uint32_t n = count - k * 700 < 700 ? count - k * 700 : 700;
        sp_bins_clear(&b.bins, k);
        sp_bins_count(&b.bins, k, grid, records + k * 700, n / 3); /* in pieces */
        sp_bins_count(&b.bins, k, grid, records + k * 700 + n / 3, n - n / 3);
        total += sp_bins_block_total(&b.bins, k);
    }
    sp_bins_start(&b.bins, 0, b.bins.blocks);
    assert_int_equal(b.bins.first[b.bins.tiles], total);
    for (uint32_t k = 0; k < b.bins.blocks; k++) {
        uint32_t n = count - k * 700 < 700 ? count - k * 700 : 700;
        sp_bins_fill(&b.bins, k, grid, records + k * 700, n / 2, k * 700);
        sp_bins_fill(&b.bins, k, grid, records + k * 700 + n / 2, n - n / 2, k * 700 + n / 2);
    }
    return b;
}

static void free_bench(struct bench *b) {
    free(b->bins.counts);
    free(b->bins.first);
    free(b->bins.entries);
    free(b->records);
}

static struct bench make_bench(const struct sp_tile_grid *grid, float cut) {
    struct sp_splat *records = malloc(SPLATS * sizeof *records);
    srand(6);
    for (uint32_t i = 0; i < SPLATS; i++)
        records[i] = random_splat(i / 300, cut);
    return sort(grid, records, SPLATS);
}

static void every_touched_tile_gets_the_splat_once_and_in_order(void **state) {
    (void)state;
    struct sp_tile_grid grid = make_grid();
    struct bench b = make_bench(&grid, 6.5f);
    for (int r = 0; r < ROWS; r++)
        for (int c = 0; c < COLUMNS; c++) {
            uint32_t e = b.bins.first[r * COLUMNS + c], stop = b.bins.first[r * COLUMNS + c + 1];
            for (uint32_t i = 0; i < SPLATS; i++) {
                const struct sp_splat *s = &b.records[i];
                bool touches = s->x0 < (c + 1) * SP_TILE && s->x1 > c * SP_TILE &&
                               s->y0 < (r + 1) * SP_TILE && s->y1 > r * SP_TILE;
                if (touches) {
                    assert_compare(e, <, stop);
                    assert_int_equal(b.bins.entries[e++], i);
                }
            }
            assert_int_equal(e, stop);
        }
    free_bench(&b);
    free_grid(&grid);
}

/* Draws the whole image without tiles, in double precision. */
static void draw_untiled(const struct sp_splat *records, float cut, double (*done)[4]) {
    double(*sums)[4] = calloc(WIDTH * HEIGHT, sizeof *sums);
    for (int p = 0; p < WIDTH * HEIGHT; p++)
        done[p][0] = 1;
    for (uint32_t i = 0; i < SPLATS; i++) {
        const struct sp_splat *s = &records[i];
        for (int p = 0; p < WIDTH * HEIGHT; p++) {
            double dx = p % WIDTH + 0.5 - (double)s->x, dy = p / WIDTH + 0.5 - (double)s->y;
            double e = (double)s->a * dx * dx + (double)s->b * dx * dy + (double)s->c * dy * dy;
            double w = e <= (double)cut ? exp2(-e) : 0;
            sums[p][0] += w * (double)s->depth;
            for (int c = 0; c < 3; c++)
                sums[p][1 + c] += w * (double)s->emission[c];
        }
        if (i + 1 < SPLATS && records[i + 1].sheet == s->sheet)
            continue;
        for (int p = 0; p < WIDTH * HEIGHT; p++) {
            double t = sums[p][0], alpha = 1 - exp(-t);
            for (int c = 0; c < 3 && t > 0; c++)
                done[p][1 + c] += done[p][0] * sums[p][1 + c] / t * alpha;
            done[p][0] *= exp(-t);
            memset(sums[p], 0, sizeof sums[p]);
        }
    }
    free(sums);
}

static void tiles_draw_what_a_brute_loop_draws(void **state) {
    (void)state;
    const float cuts[] = { 6.49f, 25.9f }; /* cutoffs 3 and 6 */
    for (int k = 0; k < 2; k++) {
        struct sp_tile_grid grid = make_grid();
        struct bench b = make_bench(&grid, cuts[k]);
        double(*truth)[4] = calloc(WIDTH * HEIGHT, sizeof *truth);
        draw_untiled(b.records, cuts[k], truth);
        double worst = 0;
        struct sp_blend blend = blending;
        blend.cut = cuts[k];
        for (int t = 0; t < COLUMNS * ROWS; t++) {
            struct sp_tile *tile = &grid.tiles[t];
            for (uint32_t e = b.bins.first[t]; e < b.bins.first[t + 1]; e++)
                sp_sheet_add(tile, &blend, &(struct sp_splats){ .splat = b.records },
                             b.bins.entries[e]);
            sp_tile_close(tile, &blend);
            for (int y = 0; y < SP_TILE; y++)
                for (int x = 0; x < SP_TILE; x++) {
                    int px = tile->x + x, py = tile->y + y;
                    for (int p = 0; p < SP_PLANES; p++) {
                        assert_compare(sp_sums_row(tile, &blend, 0, y)[p * SP_TILE + x], ==, 0);
                        double expected = px < WIDTH && py < HEIGHT ? truth[py * WIDTH + px][p] : 0;
                        worst = fmax(worst, fabs((double)tile->done[p][y][x] - expected));
                    }
                }
        }
        /* At the cutoff the weight is e^(-r²/2). Rounding decides if such a pixel counts. */
        assert_compare(worst, <, (k == 0 ? 3e-3 : 2e-5));
        free(truth);
        free_bench(&b);
        free_grid(&grid);
    }
}

static void saturated_tiles_hide_splats(void **state) {
    (void)state;
    struct sp_tile_grid grid = make_grid();
    struct sp_splat wall = {
        .x = 16, .y = 16, .a = 1e-9f, .c = 1e-9f, .depth = 1, .x1 = SP_TILE, .y1 = SP_TILE
    };
    struct sp_tile *tile = &grid.tiles[0];
    assert_false(sp_bins_is_hidden(&grid, &wall));
    for (wall.sheet = 0; wall.sheet < 8; wall.sheet++) {
        assert_false(tile->saturated); /* e^-7 is more than 1/512 > e^-8 … */
        sp_sheet_add(tile, &blending, &(struct sp_splats){ .splat = &wall }, 0);
        sp_tile_close(tile, &blending);
    }
    assert_true(tile->saturated);
    assert_true(sp_bins_is_hidden(&grid, &wall));
    wall.x1 = SP_TILE + 1; /* reaches the next tile */
    assert_false(sp_bins_is_hidden(&grid, &wall));
    free_grid(&grid);
}

static void tiles_at_the_image_edge_can_saturate(void **state) {
    (void)state;
    struct sp_tile tile;
    start_tile(&tile, 8160, 0, (int[2]){ 8192 - 20, 3 });
    struct sp_splat wall = {
        .x = 8165, .y = 1, .a = 1e-9f, .c = 1e-9f, .depth = 20, .x0 = 8160, .x1 = 8172, .y1 = 3
    };
    for (wall.sheet = 0; wall.sheet < 4; wall.sheet++) {
        sp_sheet_add(&tile, &blending, &(struct sp_splats){ .splat = &wall }, 0);
        sp_tile_close(&tile, &blending);
    }
    assert_true(tile.saturated);
    assert_compare(tile.done[0][0][0], <, 1e-8f);
    stop_tile(&tile);
}

static void make_camera(struct sp_camera_transform *frame, enum sp_projection projection,
                        const double eye[3], const double target[3]) {
    struct sp_camera camera = {
        .projection = projection, .up = { 0.1, 1, 0.2 }, .fov_y = 60, .height = 10, .near = 0.1
    };
    memcpy(camera.position, eye, sizeof camera.position);
    memcpy(camera.target, target, sizeof camera.target);
    sp_camera_transform_init(frame, &camera, (uint32_t[2]){ 64, 64 });
}

static void sheets_come_nearest_first_on_both_sides_of_the_eye(void **state) {
    (void)state;
    const struct sp_grid grid = { .dims = { 4, 8, 10 },
                                  .spacing = { 1, 1, 2 },
                                  .origin = { 0, 0, 5 },
                                  .direction = { { 1, 0, 0 }, { 0, 0, 1 }, { 0, 1, 0 } } };
    struct sp_camera_transform camera;
    /* Index axis 1 is world z. */
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 2, 3, 8.3 }, (double[3]){ 2, 3.5, 20 });
    assert_int_equal(sp_slices_major_axis(&camera, &grid), 1);
    uint32_t order[10];
    sp_slices_sort(&camera, &grid, 1, order); /* the camera is at index 3.3 */
    static const uint32_t inside[8] = { 3, 4, 2, 5, 1, 6, 0, 7 };
    for (int k = 0; k < 8; k++)
        assert_int_equal(order[k], inside[k]);
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 2, 3, -8 }, (double[3]){ 2, 3, 20 });
    sp_slices_sort(&camera, &grid, 1, order);
    for (uint32_t k = 0; k < 8; k++)
        assert_int_equal(order[k], k);
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 2, 3, 80 }, (double[3]){ 2, 3, 20 });
    sp_slices_sort(&camera, &grid, 1, order);
    for (uint32_t k = 0; k < 8; k++)
        assert_int_equal(order[k], 7 - k);
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 2, 3, 9 }, (double[3]){ 2, 3, 20 });
    sp_slices_sort(&camera, &grid, 1, order); /* exactly on slice 4 */
    assert_int_equal(order[0], 4);
    /* Parallel rays start infinitely far away, wherever the camera is. */
    make_camera(&camera, SP_ORTHOGRAPHIC, (double[3]){ 2, 10, 8 }, (double[3]){ 2, 0, 8 });
    assert_int_equal(sp_slices_major_axis(&camera, &grid), 2);
    sp_slices_sort(&camera, &grid, 2, order);
    for (uint32_t k = 0; k < 10; k++)
        assert_int_equal(order[k], 9 - k);
}

/* Compares with the definition, the component of the normal along the view, for sheared and
 * mirrored grids. */
static void the_major_axis_faces_the_view(void **state) {
    (void)state;
    const struct sp_grid grid = { .dims = { 4, 4, 4 },
                                  .spacing = { 1, 5, 1 },
                                  .direction = { { 1, 0.8, 0 }, { 0, 0.6, 0 }, { 0, 0, -1 } } };
    struct sp_camera_transform camera;
    /* Slices of axis 0 contain (0.8, 0.6, 0) and z: their normal is (0.6, -0.8, 0). */
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 60, -80, 0 }, (double[3]){ 0, 0, 0 });
    assert_int_equal(sp_slices_major_axis(&camera, &grid), 0);
    uint32_t order[4];
    sp_slices_sort(&camera, &grid, 0, order);
    assert_int_equal(order[0], 3);
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 3, 80, 0 }, (double[3]){ 0, 0, 0 });
    assert_int_equal(sp_slices_major_axis(&camera, &grid), 1);
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 3, 8, 80 }, (double[3]){ 0, 0, 0 });
    assert_int_equal(sp_slices_major_axis(&camera, &grid), 2);
    sp_slices_sort(&camera, &grid, 2, order);
    assert_int_equal(order[0], 0); /* the axis points away from +z */
}

/* Slices are sorted by their distance from the camera, although their gaps differ. */
static void rectilinear_slices_come_nearest_first(void **state) {
    (void)state;
    static const double coordinates[6] = { 0, 1, 2, 10, 11, 40 };
    const struct sp_grid grid = { .dims = { 4, 4, 6 },
                                  .spacing = { 1, 1, 8 },
                                  .origin = { 0, 0, 5 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } },
                                  .coordinates = { NULL, NULL, coordinates } };
    struct sp_camera_transform camera;
    uint32_t order[6];
    make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 2, 3, 12 }, (double[3]){ 2, 3.5, 90 });
    assert_int_equal(sp_slices_major_axis(&camera, &grid), 2);
    sp_slices_sort(&camera, &grid, 2, order); /* the camera is 7 units from the first slice */
    static const uint32_t want[6] = { 3, 4, 2, 1, 0, 5 };
    assert_memory_equal(order, want, sizeof want);
}

/* Each visible voxel is in one run, whose layer is its slice. No other voxel is in a run. */
/* Marks the voxels of a run, which must all belong to its sheet. A cell of level 1 belongs to the
 * sheet in the middle of its two slices. */
static void see_run(const struct sp_classification *c, const struct sp_run *run, unsigned axis,
                    uint32_t sheet, const uint32_t dims[3], uint16_t *seen) {
    const struct sp_visible *list = &c->levels[run->level].visible;
    uint32_t corner[3], side = 1u << run->level;
    assert_compare(run->count, >, 0);
    sp_visible_brick_corner(list->bricks, run->brick, corner);
    for (uint32_t p = run->begin; p < (uint32_t)run->begin + run->count; p++) {
        uint16_t local;
        uint32_t i[3];
        sp_visible_locals(list, run->brick, NULL, p, 1, &local);
        for (int a = 0; a < 3; a++)
            i[a] = (corner[a] + (local >> (4 * a) & 15)) * side;
        uint32_t middle = i[axis] + side / 2;
        assert_int_equal(middle < dims[axis] ? middle : dims[axis] - 1, sheet);
        for (uint32_t n = 0; n < side * side * side; n++) {
            uint32_t x = i[0] + n % side, y = i[1] + n / side % side, z = i[2] + n / side / side;
            if (x < dims[0] && y < dims[1] && z < dims[2])
                seen[x + dims[0] * (y + dims[1] * z)]++;
        }
    }
}

static void sheets_list_every_voxel_once(void **state) {
    (void)state;
    enum { X = 35, Y = 18, Z = 20 };
    static uint8_t values[X * Y * Z];
    static uint16_t seen[X * Y * Z];
    srand(11);
    for (int i = 0; i < X * Y * Z; i++)
        values[i] = (uint8_t)(rand() % 8 ? 0 : 200);
    const struct sp_grid grid = { .dims = { X, Y, Z },
                                  .spacing = { 1, 1, 1 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_volume *volume = sp_volume_create(&grid, SP_UINT8, values, "v", NULL);
    struct sp_pool *pool = sp_pool_create(2, NULL);
    struct sp_transfer_function tf = { .reference_length = 1, .point_count = 2 };
    tf.points[0].value = 100;
    tf.points[1] = (struct sp_tf_point){ .value = 200, .opacity = 0.5f };
    struct sp_classification c;
    sp_classification_init(&c, volume);
    struct sp_arena arena;
    sp_arena_init(&arena);
    /* One half along axis 0 is a brick of level 1; the other half has level 0. */
    struct sp_detail_brick bricks[] = {
        { 0, 1, false }, { 2, 0, false }, { 5, 0, false }, { 8, 0, false }, { 11, 0, false }
    };
    struct sp_detail detail = { .bricks = bricks, .count = 5, .levels = 3 };
    for (unsigned axis = 0; axis < 3; axis++) {
        struct sp_classify_job job = { .tf = &tf, .levels = 3, .axis = axis, .pool = pool };
        assert_true(sp_classification_update(&c, &job, NULL));
        struct sp_camera_transform camera;
        struct sp_order order;
        uint32_t sheets[X];
        make_camera(&camera, SP_PERSPECTIVE, (double[3]){ 9, 9, 9.2 }, (double[3]){ 1, 2, 3 });
        sp_slices_sort(&camera, &grid, axis, sheets);
        sp_arena_reset(&arena);
        assert_true(sp_order_sheets(&camera, c.levels, &detail, axis, &arena, &order));
        assert_int_equal(order.layers, grid.dims[axis]);
        memset(seen, 0, sizeof seen);
        for (uint32_t k = 0; k < order.layers; k++)
            for (uint64_t r = order.first[k]; r < order.first[k + 1]; r++)
                see_run(&c, &order.runs[r], axis, sheets[k], (const uint32_t[3]){ X, Y, Z }, seen);
        for (int i = 0; i < X * Y * Z; i++)
            if (values[i])
                assert_int_equal(seen[i], 1);
            else
                assert_true(seen[i] == 0 || i % X < 32); /* the other slice of a cell of level 1 */
    }
    sp_arena_finish(&arena);
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_touched_tile_gets_the_splat_once_and_in_order),
        cmocka_unit_test(tiles_draw_what_a_brute_loop_draws),
        cmocka_unit_test(saturated_tiles_hide_splats),
        cmocka_unit_test(tiles_at_the_image_edge_can_saturate),
        cmocka_unit_test(sheets_come_nearest_first_on_both_sides_of_the_eye),
        cmocka_unit_test(the_major_axis_faces_the_view),
        cmocka_unit_test(rectilinear_slices_come_nearest_first),
        cmocka_unit_test(sheets_list_every_voxel_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
