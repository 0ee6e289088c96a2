/* SPDX-License-Identifier: Apache-2.0
 *
 * Which arrays of a VTK file are samples and vectors, and the names of all fields:
 *
 *   1 component              NAME
 *   3, unless colours        vectors NAME, and "magnitude", "NAME x" …
 *   others                   "NAME component 1" …, of colours "NAME red" …
 *   colours of points        also "colors"
 *   of cells, beside points  the same with "NAME (cells)"
 */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "data/import/derived.h"
#include "data/import/vtk.h"

bool vtk_is_color(const struct vtk_entry *e) {
    const bool are_bytes = e->array.type->number.kind == IMPORT_UNSIGNED &&
                           e->array.type->number.size == 1 && !e->array.type->are_bits;
    return (e->components == 3 || e->components == 4) && e->role != VTK_PARTS &&
           (e->role == VTK_COLORS || e->role == VTK_RGB ||
            (are_bytes && e->role != VTK_VECTORS && e->role != VTK_NORMALS));
}

static bool is_field(const struct vtk_entry *e) {
    return (e->home == VTK_OF_POINTS || e->home == VTK_OF_CELLS) && !vtk_is_ghosts(e);
}

static bool is_vectors(const struct vtk_entry *e) {
    return e->components == 3 && e->role != VTK_PARTS && !vtk_is_color(e);
}

struct names {
    const struct vtk_volume *v;
    bool tells_cells; /* the names of arrays of cells end with " (cells)" */
};

/* The name of an array. */
static void name_array(const struct names *n, const struct vtk_entry *e, char out[SP_FIELD_BYTES]) {
    char name[SP_FIELD_BYTES + 16];
    const bool tells = e->home == VTK_OF_CELLS && n->tells_cells;
    snprintf(name, sizeof name, "%.*s%s", SP_FIELD_BYTES - (tells ? 9 : 1), e->name,
             tells ? " (cells)" : "");
    import_name(out, name);
}

/* The name of a component of an array that is neither scalars nor vectors. */
static void name_component(const struct names *n, const struct vtk_entry *e, unsigned component,
                           char out[SP_FIELD_BYTES]) {
    static const char *const colors[] = { "red", "green", "blue", "alpha" };
    char name[SP_FIELD_BYTES], ending[24], whole[2 * SP_FIELD_BYTES];
    name_array(n, e, name);
    if (vtk_is_color(e))
        snprintf(ending, sizeof ending, "%s", colors[component]);
    else
        snprintf(ending, sizeof ending, "component %u", component + 1);
    snprintf(whole, sizeof whole, "%.*s%s%s", (int)(SP_FIELD_BYTES - 2 - strlen(ending)), name,
             *name ? " " : "", ending);
    import_name(out, whole);
}

/* True if the array has the field that the source names: *component. */
static bool has_field(const struct names *n, const struct vtk_entry *e, const char *wanted,
                      unsigned *component) {
    char name[SP_FIELD_BYTES];
    *component = 0;
    name_array(n, e, name);
    if (e->components == 1)
        return strcmp(name, wanted) == 0;
    if (is_vectors(e))
        return strcmp(wanted, "magnitude") == 0 || import_is_derived_from(wanted, name);
    for (; *component < e->components; ++*component) {
        name_component(n, e, *component, name);
        if (strcmp(name, wanted) == 0)
            return true;
    }
    return false;
}

/* True if the array has the samples or the vectors that the source names. */
static bool is_wanted(const struct names *n, const struct vtk_entry *e) {
    const struct import_file *file = n->v->file;
    char name[SP_FIELD_BYTES];
    unsigned component;
    if (*file->field)
        return has_field(n, e, file->field, &component);
    name_array(n, e, name);
    return is_vectors(e) && strcmp(name, file->vectors) == 0;
}

/* Chooses points or cells: whichever has the field that the source names, and otherwise points, if
 * they have any field. Names of cells may be given without their ending if points have no such
 * array. */
static enum vtk_home choose_home(struct names *n) {
    const struct vtk_volume *v = n->v;
    const bool is_named = *v->file->field || *v->file->vectors;
    bool has[2] = { false, false };
    for (size_t i = 0; i < v->entry_count; i++)
        if (is_field(&v->entries[i]))
            has[v->entries[i].home] = true;
    const bool both = has[VTK_OF_POINTS] && has[VTK_OF_CELLS];
    for (int tells = both; tells >= 0 && is_named; tells--) {
        n->tells_cells = tells;
        for (int home = VTK_OF_POINTS; home <= VTK_OF_CELLS; home++)
            for (size_t i = 0; i < v->entry_count; i++)
                if (v->entries[i].home == (enum vtk_home)home && is_field(&v->entries[i]) &&
                    is_wanted(n, &v->entries[i]))
                    return (enum vtk_home)home;
    }
    n->tells_cells = both;
    return has[VTK_OF_POINTS] || !has[VTK_OF_CELLS] ? VTK_OF_POINTS : VTK_OF_CELLS;
}

/* How well an array suits as samples; 0 = not at all. */
static unsigned rank_samples(const struct names *n, const struct vtk_entry *e,
                             unsigned *component) {
    const bool is_named =
        *n->v->file->field && !is_vectors(e) && has_field(n, e, n->v->file->field, component);
    const bool is_usual = e->role == VTK_SCALARS;
    if (is_named)
        return 5;
    *component = 0;
    return e->components == 1 ? (is_usual ? 4 : e->role == VTK_IDS ? 2 : 3) : is_vectors(e) ? 0 : 1;
}

/* The same for vectors: the best are named by the source, or the field is computed from them. */
static unsigned rank_vectors(const struct names *n, const struct vtk_entry *e) {
    const struct import_file *file = n->v->file;
    char name[SP_FIELD_BYTES];
    name_array(n, e, name);
    const bool is_named = *file->vectors ? strcmp(file->vectors, name) == 0
                                         : import_is_derived_from(file->field, name);
    const bool is_usual = e->role == VTK_VECTORS;
    return !is_vectors(e) ? 0 : is_named ? 3 : is_usual ? 2 : 1;
}

/* The first of the best. */
static void choose(struct vtk_volume *v, const struct names *n) {
    unsigned best_samples = 0, best_vectors = 0;
    for (size_t i = 0; i < v->entry_count; i++) {
        const struct vtk_entry *e = &v->entries[i];
        unsigned component = 0;
        if (!is_field(e) || e->home != v->home)
            continue;
        const unsigned samples = rank_samples(n, e, &component);
        if (samples > best_samples) {
            best_samples = samples;
            v->samples = (struct vtk_choice){ e, component };
        }
        const unsigned vectors = rank_vectors(n, e);
        if (vectors > best_vectors) {
            best_vectors = vectors;
            v->vectors = (struct vtk_choice){ e, 0 };
        }
    }
    if (best_samples == 1 && v->vectors.entry) /* their lengths say more than a component */
        v->samples.entry = NULL;
}

static const char colors_field[] = "colors";

static const struct vtk_entry *find_colors(const struct vtk_volume *v) {
    for (size_t i = 0; i < v->entry_count && v->may_be_colored; i++)
        if (v->entries[i].home == VTK_OF_POINTS && vtk_is_color(&v->entries[i]))
            return &v->entries[i];
    return NULL;
}

/* Points without scalars and vectors keep their colours; of others, the source may ask for them. */
static void choose_colors(struct vtk_volume *v) {
    const struct import_file *file = v->file;
    const struct vtk_entry *colors = find_colors(v), *chosen = v->samples.entry;
    const bool is_scalar = chosen && chosen->components == 1;
    const bool is_asked = strcmp(file->field, colors_field) == 0 &&
                          !(is_scalar && strcmp(chosen->name, colors_field) == 0);
    const bool is_alone = !*file->field && !*file->vectors && !is_scalar && !v->vectors.entry;
    if (!colors || !(is_asked || is_alone))
        return;
    v->are_colored = true;
    v->samples = (struct vtk_choice){ colors, 0 };
    v->vectors.entry = NULL;
}

static void name_chosen(const struct vtk_volume *v, const struct names *n,
                        struct import_header *header) {
    const struct vtk_entry *e = v->samples.entry;
    if (v->are_colored)
        import_name(header->value_name, colors_field);
    else if (e && e->components == 1)
        name_array(n, e, header->value_name);
    else if (e)
        name_component(n, e, v->samples.component, header->value_name);
    if (v->vectors.entry) {
        header->has_vectors = true;
        name_array(n, v->vectors.entry, header->vector_name);
    }
}

/* Lists an array: scalars first, components of others later. */
static void list(const struct names *n, const struct vtk_entry *e, bool components,
                 struct import_header *header) {
    char name[SP_FIELD_BYTES];
    if (!is_field(e))
        return;
    name_array(n, e, name);
    if (!components && is_vectors(e) && strcmp(name, header->vector_name) != 0)
        import_header_add_other_vectors(header, name);
    if (!components && e->components == 1 && strcmp(name, header->value_name) != 0)
        import_header_add_other(header, name);
    if (!components || e->components == 1 || is_vectors(e))
        return;
    for (unsigned i = 0; i < e->components && i < SP_OTHER_FIELDS_MAX + 2; i++) {
        name_component(n, e, i, name);
        if (strcmp(name, header->value_name) != 0)
            import_header_add_other(header, name);
    }
}

/* Makes the lengths or a component of the vectors the samples: if there are no others, or if the
 * source asks for them. */
static void use_vectors(struct vtk_volume *v, struct import_header *header) {
    const char *field = v->file->field;
    const bool is_found = v->samples.entry && (!*field || strcmp(field, header->value_name) == 0);
    const bool is_derived = v->vectors.entry && !is_found &&
                            (!v->samples.entry || import_derived_of(field, header->vector_name));
    if (is_derived && v->samples.entry)
        import_header_add_other(header, header->value_name);
    if (is_derived) {
        v->samples.entry = NULL;
        import_header_use_vectors(header, field);
    } else if (v->vectors.entry) {
        import_header_list_derived(header, header->vector_name, "magnitude");
    }
}

/* Every piece that has the array must have it with the same numbers. */
static bool check_pieces(const struct vtk_volume *v, const struct vtk_choice *c,
                         struct sp_error *err) {
    for (size_t p = 0; c->entry && p < v->piece_count; p++) {
        const struct vtk_piece *piece = &v->pieces[p];
        const struct vtk_entry *e = vtk_find_entry(v, piece, c->entry->home, 0, c->entry->name);
        if (e && (e->components != c->entry->components ||
                  e->array.type->number.kind != c->entry->array.type->number.kind ||
                  e->array.type->number.size != c->entry->array.type->number.size))
            return import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, v->grid_at,
                               c->entry->array.name,
                               "piece %zu has %u components of type %s, the first has %u of type "
                               "%s; all must have the same",
                               p + 1, e->components, e->array.type->legacy, c->entry->components,
                               c->entry->array.type->legacy);
    }
    return true;
}

/* The source may say what several components are. */
static bool apply_choice(struct vtk_volume *v, struct import_header *header, struct sp_error *err) {
    const enum import_as wanted = v->file->selection.as;
    static const enum vtk_role roles[IMPORT_AS_COUNT] = { [IMPORT_AS_VECTORS] = VTK_VECTORS,
                                                          [IMPORT_AS_RGB] = VTK_RGB,
                                                          [IMPORT_AS_CHANNELS] = VTK_PARTS };
    for (size_t i = 0; i < v->entry_count && roles[wanted]; i++) {
        struct vtk_entry *e = &v->entries[i];
        if (!is_field(e) || e->role == VTK_NORMALS || e->components < 2 ||
            (wanted != IMPORT_AS_CHANNELS && e->components != 3 &&
             (wanted != IMPORT_AS_RGB || e->components != 4)))
            continue;
        e->role = roles[wanted];
        header->used_as = true;
    }
    if (wanted == IMPORT_AS_TIME)
        return sp_fail(err, SP_ERR_UNSUPPORTED, v->file->title,
                       "?as=time: a VTK file has one step; open several files, such as t*.vti");
    return header->used_as || !import_as_is_axis(wanted) ||
           sp_fail(err, SP_ERR_UNSUPPORTED, v->file->title, "?as=%s: the file has no array of %s",
                   import_as_name(wanted),
                   wanted == IMPORT_AS_VECTORS ? "three components"
                   : wanted == IMPORT_AS_RGB   ? "three or four components"
                                               : "several components");
}

bool vtk_choose(struct vtk_volume *v, struct import_header *header, struct sp_error *err) {
    struct names n = { .v = v };
    if (!apply_choice(v, header, err))
        return false;
    v->home = choose_home(&n);
    choose(v, &n);
    choose_colors(v);
    name_chosen(v, &n, header);
    for (int components = 0; components < 2; components++) {
        for (size_t i = 0; i < v->entry_count; i++)
            list(&n, &v->entries[i], components, header);
        if (!components) /* what comes from vectors stands between them */
            use_vectors(v, header);
    }
    if (find_colors(v) && !v->are_colored)
        import_header_add_other(header, colors_field);
    return check_pieces(v, &v->samples, err) && check_pieces(v, &v->vectors, err);
}
