/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of ranges.c that is compiled once per type of samples, so that a vector holds as many
 * samples as fit. ranges.c defines before each include:
 *
 *   ELEMENT       the type
 *   LINES(name)   the name with a suffix of the type
 *   LEAST, MOST   values that change no maximum and no minimum
 *   READ_LINE     sets pointers to the smallest and largest values of a stretch of samples; it may
 *                 write them to a line
 */

struct LINES(line) {
    ELEMENT low[RUN_SAMPLES], high[RUN_SAMPLES]; /* from the sample before the run on */
};

struct LINES(row) { /* range of row y of samples over all lines of a slab of regions */
    struct LINES(line) own, wide;
};

static void LINES(empty)(struct LINES(line) * line) {
    for (int i = 0; i < RUN_SAMPLES; i++) {
        line->low[i] = MOST;
        line->high[i] = LEAST;
    }
}

/* Joins the ranges of `count` samples, from sample `at` of the line on. */
static inline void LINES(join)(struct LINES(line) * line, int at, int count, const ELEMENT *low,
                               const ELEMENT *high) {
    ELEMENT *least_of = line->low + at, *most_of = line->high + at;
    for (int i = 0; i < count; i++) {
        least_of[i] = low[i] < least_of[i] ? low[i] : least_of[i];
        most_of[i] = high[i] > most_of[i] ? high[i] : most_of[i];
    }
}

static void LINES(join_lines)(struct LINES(line) * line, const struct LINES(line) * other) {
    LINES(join)(line, 0, RUN_SAMPLES, other->low, other->high);
}

static void LINES(compute_row)(const struct sp_samples *s, uint32_t first, uint32_t y,
                               uint32_t slab, struct LINES(row) * row) {
    LINES(empty)(&row->own);
    LINES(empty)(&row->wide);
    for (uint32_t z = first_near(slab); z < s->dims[2] && is_near(z, slab); z++) {
        const struct stretch stretch = compute_stretch(s, first, y, z);
        struct LINES(line) line;
        const ELEMENT *low = line.low, *high = line.high;
        READ_LINE(s, &stretch, &line, &low, &high);
        LINES(join)(is_own(z, slab) ? &row->own : &row->wide, stretch.at, stretch.count, low, high);
    }
    LINES(join_lines)(&row->wide, &row->own);
}

/* Computes, for each sample, the minimum and maximum of four samples from this sample on. */
static void LINES(join_four)(const struct LINES(line) * line, struct LINES(line) * four) {
    struct LINES(line) two;
    for (int i = 0; i < RUN_SAMPLES - 1; i++) {
        two.low[i] = line->low[i] < line->low[i + 1] ? line->low[i] : line->low[i + 1];
        two.high[i] = line->high[i] > line->high[i + 1] ? line->high[i] : line->high[i + 1];
    }
    for (int i = 0; i < RUN_SAMPLES - 3; i++) {
        four->low[i] = two.low[i] < two.low[i + 2] ? two.low[i] : two.low[i + 2];
        four->high[i] = two.high[i] > two.high[i + 2] ? two.high[i] : two.high[i + 2];
    }
}

/* Writes the ranges of `count` neighbouring regions. */
static void LINES(write_ranges)(const struct LINES(row) * row, uint32_t count, float (*range)[2]) {
    _Static_assert(SAMPLES_REGION == 4, "two stretches of four samples cover a region");
    struct LINES(line) own, wide;
    LINES(join_four)(&row->own, &own);
    LINES(join_four)(&row->wide, &wide);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t at = i * SAMPLES_REGION; /* seven samples, of which five are its own */
        const float inside[2] = { sp_minf((float)own.low[at + 1], (float)own.low[at + 2]),
                                  sp_maxf((float)own.high[at + 1], (float)own.high[at + 2]) };
        const float around[2] = { sp_minf((float)wide.low[at], (float)wide.low[at + 3]),
                                  sp_maxf((float)wide.high[at], (float)wide.high[at + 3]) };
        sp_ranges_widen(inside, around, range[i]);
    }
}

/* Computes the ranges of a run of regions along the first axis, of all rows along the second axis,
 * in one slab. */
static void LINES(compute_run)(const struct sp_samples *s, uint32_t first, uint32_t slab) {
    enum { KEPT = 8 }; /* rows of samples: neighbouring regions share three of seven */
    struct LINES(row) rows[KEPT], all;
    const uint32_t *regions = s->regions;
    uint32_t known = 0, count = regions[0] - first < RUN ? regions[0] - first : RUN;
    for (uint32_t q = 0; q < regions[1]; q++) {
        LINES(empty)(&all.own);
        LINES(empty)(&all.wide);
        for (uint32_t y = first_near(q); y < s->dims[1] && is_near(y, q); y++) {
            const struct LINES(row) *row = &rows[y % KEPT];
            for (; known <= y; known++)
                LINES(compute_row)(s, first * SAMPLES_REGION, known, slab, &rows[known % KEPT]);
            if (is_own(y, q))
                LINES(join_lines)(&all.own, &row->own);
            LINES(join_lines)(&all.wide, &row->wide);
        }
        size_t region = ((size_t)slab * regions[1] + q) * regions[0] + first;
        LINES(write_ranges)(&all, count, s->range + region);
    }
}

#undef ELEMENT
#undef LINES
#undef LEAST
#undef MOST
#undef READ_LINE
