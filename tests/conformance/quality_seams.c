/* SPDX-License-Identifier: Apache-2.0
 *
 * Seams: tiles of the image choose how they draw on their own, for instance whether their rays need
 * sheets half a slice apart. Their borders must not show.
 *
 * The test measures the mean change of colour across each border of two tiles, and from pixel to
 * pixel on both sides of it. Claim: the change across a border is at most twice the largest change
 * beside it, and 0.1 % of the range.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "conformance/quality.h"

enum { TILE = 64, BESIDE = 6, VIEWS = 4 };

/* The mean change of colour from column x − 1 to column x, in rows [y, y + TILE). is_down: the same
 * of rows. */
static double change_at(const struct test_image *image, unsigned x, unsigned y, bool is_down) {
    unsigned end = is_down ? image->width : image->height, count = 0;
    double sum = 0;
    for (unsigned i = y; i < y + TILE && i < end; i++, count += 3) {
        const double *before =
            is_down ? test_image_at(image, i, x - 1) : test_image_at(image, x - 1, i);
        const double *behind = is_down ? test_image_at(image, i, x) : test_image_at(image, x, i);
        for (int c = 0; c < 3; c++)
            sum += fabs(before[c] - behind[c]);
    }
    return sum / count;
}

struct seam {
    double excess; /* change across it, less twice the largest one beside it */
    unsigned x, y; /* px; a border to the left of x, or above it */
    bool is_down;
};

/* The most visible border between tiles. */
static struct seam measure_worst_seam(const struct test_image *image) {
    struct seam worst = { .excess = -INFINITY };
    for (int is_down = 0; is_down < 2; is_down++) {
        unsigned across = is_down ? image->height : image->width;
        unsigned along = is_down ? image->width : image->height;
        for (unsigned x = TILE; x + BESIDE < across; x += TILE)
            for (unsigned y = 0; y < along; y += TILE) {
                double beside = 0;
                for (unsigned k = 1; k <= BESIDE; k++)
                    beside = fmax(beside, fmax(change_at(image, x - k, y, is_down),
                                               change_at(image, x + k, y, is_down)));
                double excess = change_at(image, x, y, is_down) - 2 * beside;
                if (excess > worst.excess)
                    worst = (struct seam){ excess, x, y, is_down };
            }
    }
    return worst;
}

/* Volumes whose material is translucent and has hard edges show most. */
static const char *const volumes[] = { "demo:engine?size=64", "demo:phantom?size=96",
                                       "engine_256x256x128_uint8.nrrd",
                                       "bonsai_256x256x256_uint8.nrrd" };

static void measure(struct quality *q) {
    printf("  largest excess of the change across a border of tiles, in %% of the range\n");
    for (size_t i = 0; i < sizeof volumes / sizeof *volumes; i++) {
        struct sp_volume *volume = quality_load(volumes[i]);
        for (int n = 0; volume && n < VIEWS; n++) {
            struct sp_view view;
            sp_view_init(&view, sp_volume_info(volume), "seams");
            view.size[0] = 900;
            view.size[1] = 600;
            view.shading.mode = n % 2 ? SP_SHADING_NONE : SP_SHADING_PHONG;
            quality_turn(&view, n);
            struct test_image image = quality_render(q, volume, &view);
            struct seam seam = measure_worst_seam(&image);
            printf("  %-30s view %d  %7.3f  at %u, %u %s\n", volumes[i], n, 100 * seam.excess,
                   seam.is_down ? seam.y : seam.x, seam.is_down ? seam.x : seam.y,
                   seam.is_down ? "downwards" : "across");
            quality_expect(q, seam.excess <= 0.001, "%s, view %d: a border shows", volumes[i], n);
            test_image_finish(&image);
        }
        if (volume)
            quality_evict(q, &volume);
    }
}

int main(void) {
    return quality_main(measure);
}
