/* SPDX-License-Identifier: Apache-2.0
 *
 * The place of an array in the world. NetCDF has conventions for that (CF): the variable with the
 * name of a dimension has its coordinates, and attributes say what they are.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/array_reader.h"
#include "data/volume/unit.h"
#include "data/volume/volume.h"

/* Coordinates lie evenly if each is within this share of the step of its place. */
#define EVEN_SHARE 1e-3
/* More channels than these, of an array whose dimensions have no names, may be something else. */
enum { CHANNELS_MAX = 4 };

struct coordinates { /* of one dimension */
    double *values;  /* owned; NULL = none */
    char unit[64];
    bool is_down; /* they grow downwards: pressure, depth */
    enum arrays_role role;
};

static bool begins(const char *text, const char *with) {
    return strncasecmp(text, with, strlen(with)) == 0;
}

/* Finds an array of as many numbers as the dimension has; −1 = there is none. */
static int find_path(const struct arrays *a, unsigned d, const char *path) {
    struct array_info info;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++)
        if (info.is_number && info.rank == 1 && info.shape[0] == a->info.shape[d] &&
            strcmp(info.name, path) == 0)
            return (int)n;
    return -1;
}

/* Finds the array of the coordinates of a dimension: the array that the file names, or else an
 * array with the name of the dimension in the group of the data or in a group above; −1 = there is
 * none. */
static int find_array(const struct arrays *a, unsigned d) {
    char path[2 * ARRAY_NAME_BYTES], group[ARRAY_NAME_BYTES];
    if (*a->info.scales[d])
        return find_path(a, d, a->info.scales[d]);
    snprintf(group, sizeof group, "%s", a->info.name);
    while (*a->info.dims[d]) {
        char *slash = strrchr(group, '/');
        *(slash ? slash : group) = 0;
        snprintf(path, sizeof path, "%s%s%s", group, slash ? "/" : "", a->info.dims[d]);
        const int n = find_path(a, d, path);
        if (n >= 0)
            return n;
        if (!slash)
            break;
    }
    return -1;
}

static bool is_angle(const char *unit) {
    return begins(unit, "degree") || begins(unit, "rad");
}

/* True if the numbers are finite and rise or fall throughout. */
static bool are_ordered(const double *values, uint64_t count) {
    bool are = count > 0 && isfinite(values[0]);
    for (uint64_t i = 1; are && i < count; i++)
        are = isfinite(values[i]) && values[i] != values[i - 1] &&
              (values[i] > values[i - 1]) == (values[1] > values[0]);
    return are;
}

/* Longitudes that go on at −180 after 180, or at 0 after 360. */
static void unwrap(double *values, uint64_t count, double turn) {
    for (uint64_t i = 1; i < count; i++)
        values[i] += turn * round((values[i - 1] - values[i]) / turn);
}

/* Reads the coordinates of dimension d. False without memory. */
static bool read_values(const struct arrays *a, int n, unsigned d, struct coordinates *c) {
    struct array_info info;
    struct import_conversion conversion;
    const uint64_t start[IMPORT_RANK_MAX] = { 0 }, count[IMPORT_RANK_MAX] = { a->info.shape[d] };
    if (count[0] > SP_DIM_MAX || !a->call->describe(a->handle, (unsigned)n, &info))
        return true; /* without coordinates */
    void *numbers = malloc(count[0] * info.number.size);
    c->values = malloc(count[0] * sizeof *c->values);
    const bool ok = numbers && c->values;
    bool is_sound = ok && a->call->read(a->handle, (unsigned)n, start, count, numbers, NULL);
    if (is_sound) {
        arrays_read_packing(a, (unsigned)n, &info, &conversion);
        conversion.type = SP_FLOAT64;
        import_conversion_put(&conversion, numbers, count[0], c->values);
        const bool is_round = is_angle(c->unit) || (!*c->unit && begins(a->info.dims[d], "lon"));
        if (is_round && !are_ordered(c->values, count[0]))
            unwrap(c->values, count[0], begins(c->unit, "rad") ? 2 * M_PI : 360);
        is_sound = are_ordered(c->values, count[0]);
    }
    free(numbers);
    if (!is_sound) {
        free(c->values);
        c->values = NULL;
        c->unit[0] = 0; /* the indices that take their place have none */
        import_warn(a->file->warnings,
                    "The coordinates of the dimension %.60s do not rise or fall throughout; they "
                    "were left out.",
                    a->info.dims[d]);
    }
    return ok;
}

static enum arrays_role role_of(const char *name, const char *axis, const char *standard,
                                const char *unit) {
    static const char *const x[] = {
        "x", "lon", "longitude", "nlon", "projection_x_coordinate", "west_east", "west_east_stag",
        NULL
    };
    static const char *const y[] = { "y",
                                     "lat",
                                     "latitude",
                                     "nlat",
                                     "projection_y_coordinate",
                                     "south_north",
                                     "south_north_stag",
                                     NULL };
    static const char *const z[] = {
        "z",        "lev",    "level",        "plev",       "depth",           "height",
        "altitude", "levels", "air_pressure", "bottom_top", "bottom_top_stag", NULL
    };
    static const char *const time[] = { "t",     "time", "times", "hour",   "day",
                                        "month", "year", "date",  "season", NULL };
    if (strcasecmp(axis, "T") == 0 || strstr(unit, " since ") ||
        import_axes_is_one_of(standard, time) || import_axes_is_one_of(name, time))
        return ARRAYS_ROLE_TIME;
    if (strcasecmp(axis, "X") == 0 || begins(unit, "degrees_e") || begins(unit, "degree_e") ||
        import_axes_is_one_of(standard, x) || import_axes_is_one_of(name, x))
        return ARRAYS_ROLE_X;
    if (strcasecmp(axis, "Y") == 0 || begins(unit, "degrees_n") || begins(unit, "degree_n") ||
        import_axes_is_one_of(standard, y) || import_axes_is_one_of(name, y))
        return ARRAYS_ROLE_Y;
    if (strcasecmp(axis, "Z") == 0 || import_axes_is_one_of(standard, z) ||
        import_axes_is_one_of(name, z))
        return ARRAYS_ROLE_Z;
    static const char *const spectral[] = { "wavelength",
                                            "wavelengths",
                                            "wavenumber",
                                            "wavenumbers",
                                            "frequency",
                                            "frequencies",
                                            "energy",
                                            "energies",
                                            "lambda",
                                            "spectral",
                                            "radiation_wavelength",
                                            "radiation_frequency",
                                            "sensor_band_central_radiation_wavelength",
                                            "radiation_wavenumber",
                                            NULL };
    return import_axes_is_channel(name) || import_axes_is_one_of(name, spectral) ||
                   import_axes_is_one_of(standard, spectral)
               ? ARRAYS_ROLE_CHANNEL
               : ARRAYS_ROLE_NONE;
}

enum arrays_role arrays_role_of(const struct arrays *a, int n, const char *name) {
    char axis[8] = "", standard[64] = "", unit[64] = "";
    if (n >= 0) {
        a->call->text(a->handle, (unsigned)n, "units", unit, sizeof unit);
        a->call->text(a->handle, (unsigned)n, "axis", axis, sizeof axis);
        a->call->text(a->handle, (unsigned)n, "standard_name", standard, sizeof standard);
    }
    return role_of(name, axis, standard, unit);
}

/* Coordinates grow downwards where they say so, and those of pressure. CF measures a depth from the
 * surface down, unless the file says otherwise or the numbers are below 0. */
static bool is_down(const struct arrays *a, int n, unsigned d, const struct coordinates *c) {
    static const char *const pressure[] = { "hPa", "Pa",  "millibar", "millibars",
                                            "mb",  "bar", "dbar",     NULL };
    char positive[16] = "", standard[64] = "";
    if (n >= 0) {
        a->call->text(a->handle, (unsigned)n, "positive", positive, sizeof positive);
        a->call->text(a->handle, (unsigned)n, "standard_name", standard, sizeof standard);
    }
    if (strcasecmp(positive, "down") == 0 || import_axes_is_one_of(c->unit, pressure))
        return true;
    const bool is_depth =
        begins(standard, "depth") || (!*standard && strcasecmp(a->info.dims[d], "depth") == 0);
    return !*positive && is_depth && c->values && c->values[0] >= 0 &&
           c->values[a->info.shape[d] - 1] >= 0;
}

static bool read_coordinates(const struct arrays *a, unsigned d, struct coordinates *c) {
    int n = find_array(a, d);
    if (n < 0)
        n = arrays_find_auxiliary(a, d);
    if (n >= 0)
        a->call->text(a->handle, (unsigned)n, "units", c->unit, sizeof c->unit);
    c->role = arrays_role_of(a, n, a->info.dims[d]);
    if (n >= 0 && !read_values(a, n, d, c))
        return false;
    c->is_down = is_down(a, n, d, c);
    return true;
}

/* Assigns dimensions that play no part to x, y and z, the last ones first. One dimension may be
 * left, whose places are fields, and others of length 1. */
static bool assign(struct arrays *a, const struct coordinates *c, struct sp_error *err) {
    struct import_axes *axes = &a->axes;
    *axes = (struct import_axes){ .space = { -1, -1, -1 }, .channel = -1, .time = -1 };
    int rest[IMPORT_RANK_MAX];
    unsigned count = 0;
    for (unsigned i = a->info.rank; i-- > 0;) {
        int *role = c[i].role == ARRAYS_ROLE_TIME      ? &axes->time
                    : c[i].role == ARRAYS_ROLE_CHANNEL ? &axes->channel
                    : c[i].role != ARRAYS_ROLE_NONE    ? &axes->space[c[i].role - ARRAYS_ROLE_X]
                                                       : NULL;
        if (role && *role < 0)
            *role = (int)i;
        else
            rest[count++] = (int)i;
    }
    for (unsigned i = 0; i < count; i++) {
        int *to = NULL;
        for (int s = 0; s < 3 && !to; s++)
            if (axes->space[s] < 0)
                to = &axes->space[s];
        if (to && a->info.shape[rest[i]] > 1)
            *to = rest[i];
        else if (a->info.shape[rest[i]] > 1 && axes->channel < 0)
            axes->channel = rest[i];
        else if (a->info.shape[rest[i]] > 1)
            return arrays_fail(a, err, SP_ERR_UNSUPPORTED,
                               "the array has more dimensions than x, y, z, time and one of "
                               "fields; save parts of it");
    }
    for (unsigned i = 0; i < count && axes->space[0] < 0; i++)
        axes->space[0] = rest[i];                                         /* of length 1 */
    if (axes->space[0] < 0 && axes->space[1] < 0 && axes->space[2] < 0) { /* a list of channels */
        axes->space[0] = axes->channel;
        axes->channel = -1;
    }
    return axes->space[0] >= 0 || axes->space[1] >= 0 || axes->space[2] >= 0 ||
           arrays_fail(a, err, SP_ERR_UNSUPPORTED,
                       "the array has no dimension of space, such as x, y or z");
}

/* The extent of a dimension, in its coordinates or else its indices. */
static double extent_of(const struct arrays *a, const struct coordinates *c, int d) {
    const uint64_t last = d < 0 ? 0 : a->info.shape[d] - 1;
    return d < 0 ? 0 : c[d].values ? fabs(c[d].values[last] - c[d].values[0]) : (double)last;
}

/* Returns the factor that converts the coordinates of an axis to the unit of x. Fills
 * header->vertical if z has no length in that unit. */
static double factor_of(const struct arrays *a, const struct coordinates *c, int axis,
                        struct import_header *header) {
    const int d = a->axes.space[axis], of_x = a->axes.space[0];
    if (axis == 0 || d < 0 || of_x < 0)
        return 1;
    const struct sp_unit *own = sp_unit_find(c[d].unit), *x = sp_unit_find(c[of_x].unit);
    if (own && x)
        return own->meters / x->meters;
    const bool is_same =
        strcasecmp(c[d].unit, c[of_x].unit) == 0 || (is_angle(c[d].unit) && is_angle(c[of_x].unit));
    const double horizontal = fmax(extent_of(a, c, of_x), extent_of(a, c, a->axes.space[1]));
    const double vertical = extent_of(a, c, d);
    if (axis == 1 && !is_same && *c[d].unit && *c[of_x].unit)
        import_warn(a->file->warnings,
                    "The unit of y is \"%.30s\", that of x \"%.30s\"; y was not converted.",
                    c[d].unit, c[of_x].unit);
    if (axis == 1 || is_same || !(vertical > 0) || !(horizontal > 0))
        return 1;
    const bool is_open = !*c[d].unit || !*c[of_x].unit;
    if (is_open && !is_angle(c[d].unit) && !is_angle(c[of_x].unit)) {
        import_warn(a->file->warnings,
                    "Only some of the axes have a unit; their coordinates were taken as they are.");
        return 1;
    }
    import_warn(
        a->file->warnings,
        "The vertical axis has %s%.30s%s and the horizontal ones %s%.30s%s: it was scaled to "
        "a quarter of their length.",
        *c[d].unit ? "the unit \"" : "no unit", c[d].unit, *c[d].unit ? "\"" : "",
        *c[of_x].unit ? "\"" : "none", c[of_x].unit, *c[of_x].unit ? "\"" : "");
    const double factor = ARRAYS_HEIGHT_SHARE * horizontal / vertical;
    header->vertical.per_unit = c[d].is_down ? -factor : factor;
    snprintf(header->vertical.unit, sizeof header->vertical.unit, "%.31s", c[d].unit);
    return factor;
}

/* Gives an axis its coordinates, as even spacing if they are. */
static void place_axis(struct arrays *a, struct coordinates *c, int axis, double factor,
                       struct sp_grid *grid) {
    const int d = a->axes.space[axis];
    const uint32_t count = grid->dims[axis];
    double *values = d < 0 ? NULL : c[d].values;
    bool is_even = true;
    grid->spacing[axis] = factor;
    if (!values)
        return;
    a->is_placed[axis] = true;
    if (axis == 2 && c[d].is_down)
        factor = -factor;
    for (uint32_t i = 0; i < count; i++)
        values[i] *= factor;
    const double step = count > 1 ? (values[count - 1] - values[0]) / (count - 1) : 1;
    for (uint32_t i = 0; i < count; i++)
        is_even &= fabs(values[i] - values[0] - i * step) <= EVEN_SHARE * fabs(step);
    if (!is_even) {
        a->positions[axis] = values;
        c[d].values = NULL;
        import_grid_set_positions(grid, (unsigned)axis, values);
        return;
    }
    grid->spacing[axis] = fabs(step);
    grid->origin[axis] = values[0];
    grid->direction[axis][axis] = step < 0 ? -1 : 1;
}

/* "hours since 1900-01-01": the unit before the date. */
static void adopt_times(struct arrays *a, struct coordinates *c, struct import_header *header) {
    static const char *const known[][2] = { { "second", "s" },       { "minute", "min" },
                                            { "hour", "h" },         { "day", "d" },
                                            { "msec", "ms" },        { "millisecond", "ms" },
                                            { "microsecond", "us" }, { "nanosecond", "ns" } };
    const char *since = strstr(c->unit, " since ");
    char unit[64];
    snprintf(unit, sizeof unit, "%.*s", since ? (int)(since - c->unit) : 63, c->unit);
    a->times = c->values;
    c->values = NULL;
    header->steps.times = a->times;
    snprintf(header->steps.unit, sizeof header->steps.unit, "%.31s", unit);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (begins(unit, known[i][0]))
            snprintf(header->steps.unit, sizeof header->steps.unit, "%s", known[i][1]);
}

static bool set_steps(struct arrays *a, struct coordinates *c, struct import_header *header,
                      struct sp_error *err) {
    const uint64_t steps = a->axes.time < 0 ? 1 : a->info.shape[a->axes.time];
    if (!import_header_use_steps(header, a->file, steps, err))
        return false;
    if (steps > 1 && c[a->axes.time].values)
        adopt_times(a, &c[a->axes.time], header);
    return true;
}

static void set_unit(const struct arrays *a, const struct coordinates *c,
                     struct import_header *header) {
    const char *name = a->axes.space[0] < 0 ? "" : c[a->axes.space[0]].unit;
    const struct sp_unit *unit = sp_unit_find(name);
    snprintf(header->unit, sizeof header->unit, "%.31s",
             unit                                       ? unit->symbol
             : is_angle(name) && begins(name, "degree") ? "degrees"
                                                        : name);
}

static bool set_dims(const struct arrays *a, struct import_header *header, struct sp_error *err) {
    for (int axis = 0; axis < 3; axis++) {
        const int d = a->axes.space[axis];
        const uint64_t size = d < 0 ? 1 : a->info.shape[d];
        if (size > SP_DIM_MAX)
            return arrays_fail(a, err, SP_ERR_UNSUPPORTED,
                               "dimension %d has the length %" PRIu64 ", more than %u", d, size,
                               SP_DIM_MAX);
        header->grid.dims[axis] = (uint32_t)size;
    }
    return true;
}

static bool apply_conventions(struct arrays *a, struct coordinates *c, struct import_header *header,
                              struct sp_error *err) {
    double factor[3];
    if (!assign(a, c, err) || !import_axes_choose(&a->axes, a->file, a->info.shape, header, err) ||
        !set_dims(a, header, err) || !set_steps(a, c, header, err))
        return false;
    for (int axis = 0; axis < 3; axis++)
        factor[axis] = factor_of(a, c, axis, header); /* before any axis changes its coordinates */
    set_unit(a, c, header);
    for (int axis = 0; axis < 3; axis++)
        place_axis(a, c, axis, factor[axis], &header->grid);
    return true;
}

/* What dimensions without names are is a guess. */
static void warn_of_guess(const struct arrays *a) {
    const struct import_axes *axes = &a->axes;
    const int c = axes->channel;
    const uint64_t length = c < 0 ? 0 : a->info.shape[c];
    if (length > 1 && c > axes->space[0] && (!axes->are_colors || c == 2))
        import_warn(
            a->file->warnings,
            "The file does not tell what its dimensions are; the last one, of length %" PRIu64
            ", was taken for channels.",
            length);
    else if (length > CHANNELS_MAX && c < axes->space[0])
        import_warn(a->file->warnings,
                    "The file does not tell what its dimensions are; the %s one, of length %" PRIu64
                    ", was taken for channels%s.",
                    c == 0 ? "first" : "second", length,
                    c == 0 ? "; with ?as=time its entries are steps in time" : "");
}

static bool apply_guess(struct arrays *a, struct coordinates *c, struct import_header *header,
                        struct sp_error *err) {
    const char *names[IMPORT_RANK_MAX] = { NULL };
    if (!import_axes_guess(&a->axes, a->info.rank, a->info.shape, names, a->info.number.size == 1))
        return arrays_fail(a, err, SP_ERR_UNSUPPORTED,
                           "the array has %u dimensions; supported are t, c, z, y and x",
                           a->info.rank);
    if (!import_as_is_axis(a->file->selection.as))
        warn_of_guess(a);
    return import_axes_choose(&a->axes, a->file, a->info.shape, header, err) &&
           set_dims(a, header, err) && set_steps(a, c, header, err);
}

bool arrays_read_axes(struct arrays *a, struct import_header *header, struct sp_error *err) {
    struct coordinates c[IMPORT_RANK_MAX];
    bool ok = arrays_check_cells(a, err), is_told = false; /* by a name or coordinates */
    memset(c, 0, sizeof c);
    if (!ok)
        return false;
    arrays_read_tags(a);
    for (unsigned d = 0; ok && d < a->info.rank; d++) {
        ok = read_coordinates(a, d, &c[d]);
        is_told |= ok && (c[d].role != ARRAYS_ROLE_NONE || c[d].values);
    }
    ok = ok ? is_told ? apply_conventions(a, c, header, err) : apply_guess(a, c, header, err)
            : sp_fail(err, SP_ERR_MEMORY, a->title, "out of memory for coordinates");
    if (ok) {
        arrays_read_sizes(a, header);
        arrays_warn_of_auxiliary(a);
    }
    for (unsigned d = 0; d < IMPORT_RANK_MAX; d++)
        free(c[d].values);
    return ok;
}
