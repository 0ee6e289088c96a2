/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/transfer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/minmax.h"
#include "data/default_view/field.h"

enum { BINS = SP_FIRST_BINS, CLASSES = 4 };

/* The values of the volume in classes: class c holds the bins [cut[c], cut[c + 1]). Class 0 is
 * transparent. */
struct classes {
    bool has_surroundings;
    bool are_faint; /* the surroundings: they have many values, as the quiet parts of a field */
    unsigned cut[CLASSES + 1];
    double depth[CLASSES]; /* mean length of a line of sight in the class, world units */
    double hidden;         /* share of classes 1 and 2 that class 3 hides along a line of sight */
    double hidden_middle;  /* the same of class 2 alone */
    double roughness;      /* of visible values: mean second difference / mean first difference */
};

static uint64_t total_of(const uint64_t counts[BINS]) {
    uint64_t n = 0;
    for (int b = 0; b < BINS; b++)
        n += counts[b];
    return n;
}

/* The bin that the share q of the counts does not exceed. */
static unsigned quantile(const uint64_t counts[BINS], double q) {
    double target = q * (double)total_of(counts), sum = 0;
    for (unsigned b = 0; b < BINS; b++)
        if ((sum += (double)counts[b]) > target)
            return b;
    return BINS - 1;
}

static int compare(const void *a, const void *b) {
    return *(const int *)a - *(const int *)b;
}

enum { FULL = -1, MASKED = -2 };

/* The surroundings are what most of the volume's faces show. An object may be cut by some faces, so
 * the second darkest of them decides. Returns the highest bin of the surroundings; FULL if the
 * faces show many values, as the object fills the volume; MASKED if they show no number. */
static int measure_surroundings(const struct sp_default_samples *s) {
    int tops[6], faces = 0;
    for (int f = 0; f < 6; f++)
        if (total_of(s->faces[f])) {
            int bottom = (int)quantile(s->faces[f], 0.1), middle = (int)quantile(s->faces[f], 0.5);
            int top = (int)quantile(s->faces[f], 0.9);
            /* Twice the way from the median to 90 % is 2.6 deviations of a normal noise. */
            tops[faces++] = top - bottom < BINS / 6 ? 2 * top - middle : BINS;
        }
    if (faces == 0)
        return MASKED;
    qsort(tops, (size_t)faces, sizeof *tops, compare);
    int top = tops[faces > 3]; /* without padding, two to four faces are left */
    double below = 0;
    for (int b = 0; b <= top && b < BINS; b++)
        below += (double)s->histogram[b];
    double share = below / (double)total_of(s->histogram);
    return top < BINS / 2 && share > 0.15 ? top : FULL;
}

void sp_default_split(const uint64_t histogram[BINS], unsigned begin, unsigned end, unsigned count,
                      unsigned *cut) {
    double weight[BINS + 1] = { 0 }, moment[BINS + 1] = { 0 }, best[CLASSES][BINS + 1];
    uint16_t from[CLASSES][BINS + 1];
    for (unsigned b = begin; b < end; b++) {
        double w = sqrt((double)histogram[b]) + 1e-9; /* an empty class is still one */
        weight[b + 1] = weight[b] + w;
        moment[b + 1] = moment[b] + w * b;
    }
    for (unsigned c = 0; c < count; c++)
        for (unsigned stop = begin + c + 1; stop <= end; stop++) {
            best[c][stop] = -1;
            for (unsigned start = begin + c; start < (c ? stop : begin + 1); start++) {
                double m = moment[stop] - moment[start], w = weight[stop] - weight[start];
                double sum = m * m / w + (c ? best[c - 1][start] : 0);
                if (sum > best[c][stop]) {
                    best[c][stop] = sum;
                    from[c][stop] = (uint16_t)start;
                }
            }
        }
    cut[0] = begin;
    cut[count] = end;
    for (unsigned c = count - 1, stop = end; c > 0; c--)
        cut[c] = stop = from[c][stop];
}

enum { LINES = 64 }; /* lines of sight across an axis, nearly */

/* Sums what the lines of sight along an axis meet. */
struct lines {
    uint64_t hits[CLASSES];                  /* lines that meet the class */
    uint64_t exposed[CLASSES], all[CLASSES]; /* samples that class 3 does not hide; all, twice */
    double first, second;                    /* sums of first and second differences */
};

static void measure_line(const uint16_t *bin, size_t stride, uint32_t n,
                         const uint8_t class_of[BINS], struct lines *lines, unsigned met[CLASSES]) {
    uint32_t before = n, after = 0; /* the first and last sample of class 3 */
    for (uint32_t i = 0; i < n; i++) {
        unsigned v = bin[i * stride], class = v == SP_FIRST_NONE ? 0 : class_of[v];
        met[class]++;
        if (class == CLASSES - 1) {
            before = before < n ? before : i;
            after = i;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        unsigned v = bin[i * stride], class = v == SP_FIRST_NONE ? 0 : class_of[v];
        if (class == 0)
            continue;
        lines->all[class] += 2;
        lines->exposed[class] += (uint64_t)(i < before) + (before == n || i > after);
        if (i == 0 || i + 1 == n)
            continue;
        int low = bin[(i - 1) * stride], high = bin[(i + 1) * stride];
        if (low != SP_FIRST_NONE && high != SP_FIRST_NONE) {
            lines->first += abs(high - low);
            lines->second += abs(high - 2 * (int)v + low);
        }
    }
}

static void measure_lines(const struct sp_default_samples *s, unsigned axis,
                          const uint8_t class_of[BINS], struct classes *c, struct lines *lines) {
    const size_t stride[3] = { 1, s->count[0], (size_t)s->count[0] * s->count[1] };
    unsigned b = (axis + 1) % 3, d = (axis + 2) % 3;
    uint32_t over_b = 1 + s->count[b] / LINES, over_d = 1 + s->count[d] / LINES;
    for (uint32_t k = over_d / 2; k < s->count[d]; k += over_d)
        for (uint32_t j = over_b / 2; j < s->count[b]; j += over_b) {
            unsigned met[CLASSES] = { 0 };
            measure_line(s->bins + k * stride[d] + j * stride[b], stride[axis], s->count[axis],
                         class_of, lines, met);
            for (int x = 0; x < CLASSES; x++) {
                lines->hits[x] += met[x] > 0;
                c->depth[x] += met[x] * s->cell[axis];
            }
        }
}

static void measure_classes(const struct sp_default_samples *s, struct classes *c) {
    memset(c->depth, 0, sizeof c->depth);
    uint8_t class_of[BINS];
    struct lines lines = { 0 };
    for (unsigned b = 0, x = 0; b < BINS; b++) {
        while (x < CLASSES && b >= c->cut[x + 1])
            x++;
        class_of[b] = (uint8_t)(x < CLASSES ? x : 0);
    }
    for (unsigned axis = 0; axis < 3; axis++)
        measure_lines(s, axis, class_of, c, &lines);
    for (int x = 0; x < CLASSES; x++)
        c->depth[x] /= lines.hits[x] ? (double)lines.hits[x] : 1;
    double middle = (double)lines.all[2], inner = (double)lines.all[1] + middle;
    c->hidden_middle = middle > 0 ? 1 - (double)lines.exposed[2] / middle : 0;
    c->hidden = inner > 0 ? 1 - ((double)lines.exposed[1] + (double)lines.exposed[2]) / inner : 0;
    c->roughness = lines.first > 0 ? lines.second / lines.first : 1;
}

enum { HALF = 3 }; /* bins on each side that smooth a histogram */

static double smooth_count(const uint64_t histogram[BINS], unsigned bin) {
    double sum = 0;
    for (unsigned b = bin > HALF ? bin - HALF : 0; b <= bin + HALF && b < BINS; b++)
        sum += (double)histogram[b];
    return sum;
}

/* The end of a peak that falls at `bin`, before `limit`: noise of the surroundings. */
static unsigned leave_peak(const uint64_t histogram[BINS], unsigned bin, unsigned limit) {
    double last = INFINITY;
    for (; bin < limit; bin++) {
        double sum = smooth_count(histogram, bin);
        if (last < INFINITY && !(last > 1.15 * sum))
            break;
        last = sum;
    }
    return bin;
}

/* A floor covers at least this share of a face, with values that are this many times as frequent
 * there as in the volume: it is thinner than a fifth of the volume. An object that a face cuts has
 * its values inside as well. */
static const double floor_share = 0.15, floor_excess = 5;

/* The first bin above the values of a floor, a slab or table along a face. `bin` if there is no
 * floor, or if its values reach `limit`, where the values of the object begin. */
static unsigned leave_floor(const struct sp_default_samples *s, unsigned bin, unsigned limit) {
    double volume = (double)total_of(s->histogram);
    unsigned end = bin;
    for (int f = 0; f < 6; f++) {
        double face = (double)total_of(s->faces[f]), share = 0;
        unsigned b = bin;
        for (; face > 0 && b < limit; b++) {
            double excess = smooth_count(s->faces[f], b) / face -
                            floor_excess * smooth_count(s->histogram, b) / volume;
            if (excess <= 0 && share > 0)
                break;
            share += excess > 0 ? (double)s->faces[f][b] / face : 0;
        }
        if (share >= floor_share && b < limit && b > end)
            end = b;
    }
    return end;
}

/* Less than this share of the highest count of a class is no matter but blurred edges. */
static const double edge_share = 0.05;

/* Where the matter of the class [bin, end) begins, at most at `limit`. Below lie values of edges.
 * The object shows without them; the thin plates of a holder have no others. */
static unsigned leave_edges(const uint64_t histogram[BINS], unsigned bin, unsigned limit,
                            unsigned end) {
    double most = 0;
    for (unsigned b = bin; b < end; b++)
        most = fmax(most, smooth_count(histogram, b));
    while (bin < limit && smooth_count(histogram, bin) < edge_share * most)
        bin++;
    return bin;
}

static void choose_classes(const struct sp_default_samples *s, struct classes *c) {
    *c = (struct classes){ 0 };
    int top = measure_surroundings(s);
    c->has_surroundings = top != FULL;
    c->are_faint = top >= BINS / 16;
    sp_default_split(s->histogram, 0, BINS, CLASSES, c->cut);
    if (top >= 0 && (int)c->cut[1] <= top)
        sp_default_split(s->histogram, (unsigned)top + 1, BINS, CLASSES - 1, c->cut + 1);
    if (top == MASKED)
        c->cut[1] = 0;
    if (top >= 0) {
        unsigned limit = (c->cut[1] + c->cut[2]) / 2;
        unsigned first = leave_floor(s, leave_peak(s->histogram, c->cut[1], limit), limit);
        c->cut[1] = leave_edges(s->histogram, first, limit, c->cut[2]);
    }
    if (top == FULL) { /* show the highest values */
        c->cut[1] = c->cut[2];
        c->cut[2] = (c->cut[1] + c->cut[3]) / 2;
    }
    measure_classes(s, c);
}

/* Opacity over the reference length at which a line of sight through `depth` has this optical
 * depth. */
static float opacity_for(double optical_depth, double depth, double reference) {
    return (float)(1 - exp(-optical_depth * reference / fmax(depth, reference)));
}

/* Values rise, or fall if the samples are mirrored. */
static void add_point(const struct sp_default_samples *s, struct sp_transfer_function *tf,
                      double bin, const float color[3], float opacity) {
    const double value = sp_default_value(s, bin);
    const double last = tf->point_count ? tf->points[tf->point_count - 1].value : NAN;
    if (s->low < s->high ? value <= last : value >= last)
        return;
    struct sp_tf_point *p = &tf->points[tf->point_count++];
    p->value = value;
    memcpy(p->color, color, sizeof p->color);
    p->opacity = opacity;
}

/* From skin to bone: matter with surfaces. */
static const float warm[7][3] = { { 0.62f, 0.26f, 0.18f }, { 0.84f, 0.48f, 0.34f },
                                  { 0.92f, 0.66f, 0.50f }, { 0.95f, 0.78f, 0.60f },
                                  { 0.98f, 0.90f, 0.76f }, { 1.00f, 0.96f, 0.88f },
                                  { 1.00f, 1.00f, 1.00f } };
/* From violet to yellow: smooth fields, whose values tell more than their surfaces. */
static const float glow[7][3] = { { 0.36f, 0.26f, 0.80f }, { 0.58f, 0.34f, 0.86f },
                                  { 0.84f, 0.38f, 0.70f }, { 0.97f, 0.50f, 0.48f },
                                  { 1.00f, 0.68f, 0.36f }, { 1.00f, 0.86f, 0.46f },
                                  { 1.00f, 0.98f, 0.78f } };

/* How the classes look: colours, and the optical depth of a line of sight through the mean depth of
 * each class. */
struct look {
    const float (*colors)[3]; /* 7; NULL = the colours of a field */
    double depth[CLASSES];
    double shell;       /* the bin from which on values belong to a shell; 0 = there is none */
    double shell_depth; /* as classes.depth, and its optical depth */
    double shell_optical;
};

/* Below this roughness a field is smooth. CT and MR have 0.45 and more, simulations less. */
static const double smooth = 0.42;

static struct look choose_look(const struct classes *c) {
    if (c->roughness < smooth)
        return (struct look){ NULL, { 0, 0.9, 1.8, 6 }, 0, 0, 0 };
    if (!c->has_surroundings)
        return (struct look){ warm, { 0, 0.5, 2, 8 }, 0, 0, 0 };
    return (struct look){ warm, { 0, 1.5, 5, 12 }, 0, 0, 0 };
}

/* Makes the densest class, which encloses all else, a thin veil, and splits what is inside. The
 * middle class is either inside as well, or the blurred edge of the shell. */
static void look_inside(const struct sp_default_samples *s, struct classes *c, struct look *look) {
    unsigned end = c->hidden_middle > 0.9 ? c->cut[3] : c->cut[2], most = c->cut[1];
    for (unsigned b = most; b < end; b++)
        most = s->histogram[b] > s->histogram[most] ? b : most;
    unsigned rest = leave_peak(s->histogram, most + HALF, end); /* denser than what fills it */
    if (rest + 2 > end)
        return;
    *look = (struct look){ glow, { 0, 0.25, 4, 8 }, end, c->depth[3], 0.15 };
    sp_default_split(s->histogram, rest, end, 2, c->cut + 2);
    measure_classes(s, c);
}

static void add_points(const struct sp_default_samples *s, const struct classes *c,
                       const struct look *look, struct sp_transfer_function *tf) {
    static const float least[CLASSES] = { 0, 0.002f, 0.005f, 0.01f };
    /* The blurred edge of a shell has all values of the inside: they must not be opaque there. */
    bool is_inside = look->shell > 0;
    const float most[CLASSES] = { 0, 0.3f, is_inside ? 0.12f : 0.5f, is_inside ? 0.2f : 0.85f };
    const float(*colors)[3] = look->colors;
    double first = c->cut[1], second = c->cut[2], third = c->cut[3], length = tf->reference_length;
    float o[CLASSES];
    for (int x = 1; x < CLASSES; x++)
        o[x] = sp_clampf(opacity_for(look->depth[x], c->depth[x], length), least[x], most[x]);
    add_point(s, tf, first, colors[0], 0);
    add_point(s, tf, first + 0.35 * (second - first), colors[1], 0.6f * o[1]);
    add_point(s, tf, first + 0.8 * (second - first), colors[2], o[1]);
    add_point(s, tf, second, colors[3], is_inside ? o[1] : 0.5f * (o[1] + o[2]));
    add_point(s, tf, second + 0.5 * (third - second), colors[4], o[2]);
    add_point(s, tf, third, colors[5], 0.5f * (o[2] + o[3]));
    if (look->shell > 0) {
        add_point(s, tf, 0.5 * (third + look->shell), colors[6], o[3]);
        o[3] = opacity_for(look->shell_optical, look->shell_depth, length);
        add_point(s, tf, look->shell, colors[6], o[3]);
    }
    add_point(s, tf, BINS, colors[6], o[3]);
}

enum { FIELD_POINTS = 17 };

/* The opacity at a bin, given those at some of them. */
static float opacity_at(const double bins[], const float opacity[], int n, double bin) {
    int i = 1;
    while (i < n - 1 && bins[i] < bin)
        i++;
    const double length = bins[i] - bins[i - 1];
    const double share = length > 0 ? fmin(fmax((bin - bins[i - 1]) / length, 0), 1) : 1;
    return (float)((1 - share) * (double)opacity[i - 1] + share * (double)opacity[i]);
}

/* A smooth field: colours tell equal steps of the value, and opacity rises with it. If the field
 * fills the volume, all of it shows, the lowest class as a haze. */
static void add_field(const struct sp_default_samples *s, struct classes *c,
                      const struct look *look, struct sp_transfer_function *tf) {
    const double length = tf->reference_length, haze = 0.35;
    double depth[CLASSES];
    float o[CLASSES];
    memcpy(depth, look->depth, sizeof depth);
    if (!c->has_surroundings) {
        sp_default_split(s->histogram, 0, BINS, CLASSES, c->cut);
        measure_classes(s, c);
        depth[0] = haze;
    }
    for (int x = 0; x < CLASSES; x++)
        o[x] = sp_clampf(opacity_for(depth[x], c->depth[x], length), 0, 0.85f);
    for (int x = 1; x < CLASSES; x++) /* a rising value never becomes fainter */
        o[x] = fmaxf(o[x], o[x - 1]);
    const double first = c->has_surroundings ? c->cut[1] : 0;
    const double bins[] = { first,
                            c->has_surroundings ? first : 0.5 * c->cut[1],
                            0.5 * (c->cut[1] + c->cut[2]),
                            0.5 * (c->cut[2] + c->cut[3]),
                            0.5 * (c->cut[3] + BINS),
                            BINS };
    const float opacity[] = { c->has_surroundings ? 0 : 0.5f * o[0],
                              c->has_surroundings ? 0 : o[0],
                              o[1],
                              o[2],
                              o[3],
                              o[3] };
    for (int i = 0; i < FIELD_POINTS; i++) {
        const double share = (double)i / (FIELD_POINTS - 1), bin = first + share * (BINS - first);
        float color[3];
        sp_default_field_color(share, color);
        add_point(s, tf, bin, color, opacity_at(bins, opacity, 6, bin));
    }
}

/* Values beyond the data are marks of missing ones: the ends of the function become transparent. */
static void hide_missing(const struct sp_volume_info *info, struct sp_transfer_function *tf) {
    const double *data = info->data, *range = info->range, span = data[1] - data[0];
    struct sp_tf_point *p = tf->points, first = p[0], last = p[tf->point_count - 1];
    const double below = fmin(span, data[0] - range[0]) / 100,
                 above = fmin(span, range[1] - data[1]) / 100;
    if (tf->point_count + 2 > SP_TF_POINTS_MAX)
        return;
    if (above > 0 && last.value <= data[1]) {
        p[tf->point_count] = last;
        p[tf->point_count].opacity = 0;
        p[tf->point_count++].value = data[1] + above;
    }
    if (below > 0 && first.value >= data[0] && first.opacity > 0) {
        memmove(p + 1, p, tf->point_count++ * sizeof *p);
        p[0] = first;
        p[0].opacity = 0;
        p[0].value = data[0] - below;
    }
}

/* True if nearly all faces show the highest values alone: the background of a microscope in bright
 * field, or a mark for missing data that is not far from the others. */
static bool are_surroundings_bright(const struct sp_default_samples *s) {
    int faces = 0, bright = 0;
    for (int f = 0; f < 6; f++)
        if (total_of(s->faces[f])) {
            faces++;
            bright += quantile(s->faces[f], 0.2) > BINS - BINS / 8;
        }
    /* Values below are rare in the surroundings, and what there is of them is the object. */
    return faces >= 4 && bright >= faces - 1 && quantile(s->histogram, 0.005) < BINS / 2;
}

static void reverse(uint64_t counts[BINS]) {
    for (int b = 0; b < BINS / 2; b++) {
        const uint64_t other = counts[b];
        counts[b] = counts[BINS - 1 - b];
        counts[BINS - 1 - b] = other;
    }
}

/* Makes the highest values the lowest ones. False if there is no memory for the bins, which the
 * caller frees. */
static bool mirror(const struct sp_default_samples *s, struct sp_default_samples *mirrored) {
    const size_t n = (size_t)s->count[0] * s->count[1] * s->count[2];
    *mirrored = *s;
    mirrored->low = s->high;
    mirrored->high = s->low;
    mirrored->bins = malloc(n * sizeof *mirrored->bins);
    for (size_t i = 0; mirrored->bins && i < n; i++)
        mirrored->bins[i] =
            s->bins[i] == SP_FIRST_NONE ? SP_FIRST_NONE : (uint16_t)(BINS - 1 - s->bins[i]);
    reverse(mirrored->histogram);
    for (int f = 0; f < 6; f++)
        reverse(mirrored->faces[f]);
    return mirrored->bins != NULL;
}

static void reverse_points(struct sp_transfer_function *tf) {
    for (uint32_t i = 0; i < tf->point_count / 2; i++) {
        const struct sp_tf_point other = tf->points[i];
        tf->points[i] = tf->points[tf->point_count - 1 - i];
        tf->points[tf->point_count - 1 - i] = other;
    }
}

/* Fills the points. True if values matter more than light. */
static bool choose_points(const struct sp_default_samples *s, struct sp_transfer_function *tf) {
    const bool is_coarse = s->info->whole.dims[0] > 0;
    const double *spacing = is_coarse ? s->info->whole.spacing : s->info->grid.spacing;
    struct classes c;
    choose_classes(s, &c);
    struct look look = choose_look(&c);
    if (c.has_surroundings && c.hidden > 0.9)
        look_inside(s, &c, &look);
    tf->reference_length = fmin(spacing[0], fmin(spacing[1], spacing[2]));
    tf->point_count = 0;
    const bool is_field = !look.colors;
    if (is_field && c.are_faint)
        c.has_surroundings = false;
    if (sp_default_is_signed(s))
        sp_default_show_signed(s, tf);
    else if (is_field)
        add_field(s, &c, &look, tf);
    else
        add_points(s, &c, &look, tf);
    return look.colors != warm;
}

bool sp_default_transfer(const struct sp_default_samples *s, struct sp_transfer_function *tf) {
    struct sp_default_samples mirrored;
    bool values_matter;
    if (!sp_default_is_signed(s) && are_surroundings_bright(s) && mirror(s, &mirrored)) {
        values_matter = choose_points(&mirrored, tf);
        reverse_points(tf);
        free(mirrored.bins);
    } else {
        values_matter = choose_points(s, tf);
    }
    hide_missing(s->info, tf);
    return values_matter;
}

void sp_default_extinction(const struct sp_default_samples *samples,
                           const struct sp_transfer_function *tf,
                           double extinction[SP_FIRST_BINS]) {
    for (int b = 0; b < BINS; b++) {
        double value = sp_default_value(samples, b + 0.5), opacity;
        const struct sp_tf_point *p = tf->points, *end = p + tf->point_count;
        while (p < end && p->value <= value)
            p++;
        if (p == tf->points)
            opacity = p->opacity;
        else if (p == end)
            opacity = p[-1].opacity;
        else
            opacity = p[-1].opacity + (p->opacity - p[-1].opacity) * (value - p[-1].value) /
                                          (p->value - p[-1].value);
        extinction[b] = -log(1 - opacity) / tf->reference_length;
    }
}
