/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/meaning.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static bool fits(enum import_as as, const struct import_extra *extra) {
    const uint64_t n = extra->count;
    switch (as) {
    case IMPORT_AS_TIME:
        return n > 1 && n <= SP_STEPS_MAX && !extra->are_parts;
    case IMPORT_AS_VECTORS:
        return n == 3 && !extra->are_parts && !extra->no_vectors;
    case IMPORT_AS_RGB:
        return n == 3 || n == 4;
    case IMPORT_AS_CHANNELS:
        return n > 1;
    default:
        return true;
    }
}

/* Writes "time, channels or labels". */
static void list_fitting(const struct import_extra *extra, char *out, size_t size) {
    int left = 0;
    size_t used = 0;
    for (int as = IMPORT_AS_TIME; as <= IMPORT_AS_LABELS; as++)
        left += fits((enum import_as)as, extra);
    out[0] = 0;
    for (int as = IMPORT_AS_TIME; as <= IMPORT_AS_LABELS && used < size; as++)
        if (fits((enum import_as)as, extra)) {
            left--;
            used += (size_t)snprintf(out + used, size - used, "%s%s",
                                     import_as_name((enum import_as)as),
                                     left > 1   ? ", "
                                     : left > 0 ? " or "
                                                : "");
        }
}

bool import_meaning_choose(const struct import_file *file, const struct import_extra *extra,
                           struct import_header *header, enum import_as *as, struct sp_error *err) {
    const enum import_as wanted = file->selection.as;
    char list[64];
    *as = extra->count > 1 ? extra->meaning : IMPORT_AS_FILE;
    if (!import_as_is_axis(wanted))
        return true;
    header->used_as = true;
    if (fits(wanted, extra)) {
        *as = wanted;
        return true;
    }
    list_fitting(extra, list, sizeof list);
    if (extra->count < 2)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "?as=%s: the file has one number per voxel; only %s fits",
                       import_as_name(wanted), list);
    return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                   "?as=%s: the file has %" PRIu64 " numbers per voxel; choose %s",
                   import_as_name(wanted), extra->count, list);
}

unsigned import_meaning_choose_component(const struct import_file *file,
                                         struct import_header *header, unsigned count,
                                         enum import_as as, const char *const *names) {
    unsigned chosen = 0;
    if (!names)
        return import_header_choose_component(header, file->field, count, as == IMPORT_AS_RGB);
    for (unsigned i = 0; i < count; i++)
        chosen = strcmp(names[i], file->field) == 0 ? i : chosen;
    import_name(header->value_name, names[chosen]);
    for (unsigned i = 0; i < count; i++)
        if (i != chosen)
            import_header_add_other(header, names[i]);
    return chosen;
}

const char *const import_tensor_names[6] = { "xx", "xy", "xz", "yy", "yz", "zz" };

/* CIFTI-2 holds matrices of brain nodes and voxels in a NIfTI-2 file. */
static const char *refusal_of_cifti(int code) {
    enum { FIRST_CIFTI = 3000, LAST_CIFTI = 3099 };
    return code >= FIRST_CIFTI && code <= LAST_CIFTI ? "a matrix of CIFTI-2" : NULL;
}

static const char *const lower_names[] = { "xx", "xy", "yy", "xz", "yz", "zz" };
static const char *const turn_names[] = { "w", "x", "y", "z" };
#define COEFFICIENT                                                                                \
    { .name = "coefficient", .as = IMPORT_AS_CHANNELS, .warning = "coefficients of a deformation" }

static const struct {
    int code;
    struct import_intent intent;
} intents[] = {
    { 1001, { .name = "estimate", .meaning = SP_MEANING_STATISTIC } },
    { 1002, { .name = "label", .meaning = SP_MEANING_LABELS } },
    { 1003, { .name = "neuroname", .meaning = SP_MEANING_LABELS } },
    { 1004, { .name = "", .as = IMPORT_AS_CHANNELS } }, /* a matrix of any size */
    { 1005, { .name = "tensor", .as = IMPORT_AS_CHANNELS, .names = lower_names, .name_count = 6 } },
    { 1006, { .name = "displacement", .as = IMPORT_AS_VECTORS } },
    { 1007, { .name = "", .as = IMPORT_AS_VECTORS } },
    { IMPORT_INTENT_FNIRT, { .name = "", .as = IMPORT_AS_VECTORS } },
    { 1008, { .refusal = "a list of points" } },
    { 1009, { .refusal = "the triangles of a surface" } },
    { 1010,
      { .name = "quaternion", .as = IMPORT_AS_CHANNELS, .names = turn_names, .name_count = 4 } },
    { 2001, { .name = "", .as = IMPORT_AS_TIME } },
    { 2002, { .refusal = "values of the nodes of a surface" } },
    { 2003, { .name = "", .as = IMPORT_AS_RGB } },
    { 2004, { .name = "", .as = IMPORT_AS_RGB } },
    { 2005, { .refusal = "values of the nodes of a surface" } },
    { 2007, COEFFICIENT },
    { 2008, COEFFICIENT },
    { 2009, COEFFICIENT },
    { 2016, COEFFICIENT },
    { 2017, COEFFICIENT },
    { 2018, { .name = "field" } }, /* of FSL's topup, in Hz */
};

struct import_intent import_intent_of(int code) {
    static const char *const statistics[] = {
        "correlation",    "t statistic", "F statistic",     "z score",          "chi squared",
        "beta statistic", "binomial",    "gamma statistic", "Poisson",          "normal statistic",
        "F statistic",    "chi squared", "logistic",        "Laplace",          "uniform",
        "t statistic",    "Weibull",     "chi statistic",   "inverse Gaussian", "extreme value",
        "p value",        "log p value", "log10 p value",
    };
    enum { FIRST_STATISTIC = 2, P_VALUE = 22, LAST_STATISTIC = 24 };
    if (code >= FIRST_STATISTIC && code <= LAST_STATISTIC)
        return (struct import_intent){ .meaning = code < P_VALUE ? SP_MEANING_STATISTIC
                                                                 : SP_MEANING_UNKNOWN,
                                       .as = IMPORT_AS_CHANNELS,
                                       .name = statistics[code - FIRST_STATISTIC] };
    for (size_t i = 0; i < sizeof intents / sizeof *intents; i++)
        if (intents[i].code == code)
            return intents[i].intent;
    return (struct import_intent){ .name = "", .refusal = refusal_of_cifti(code) };
}

bool import_meaning_are_directions(const float *squares, uint64_t count) {
    enum { FEW = 8 };
    const float zero = 1e-4f, tolerance = 0.03f; /* also of integers that were rescaled */
    uint64_t some = 0, good = 0;
    for (uint64_t i = 0; i < count; i++) {
        some += squares[i] > zero;
        good += squares[i] > 1 - tolerance && squares[i] < 1 + tolerance;
    }
    return some >= FEW && (double)good >= 0.95 * (double)some;
}
