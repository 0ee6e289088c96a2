/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/vtk.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/grow.h"
#include "data/import/confine.h"
#include "data/import/derived.h"

enum { PIECES_MAX = 1 << 16, ENTRIES_MAX = 1 << 22, FILES_MAX = 1 << 16 };

void vtk_init(struct vtk_volume *v, const struct import_file *file) {
    memset(v, 0, sizeof *v);
    v->file = file;
    v->other.fd = -1;
    v->time = NAN;
    for (int axis = 0; axis < 3; axis++)
        v->image.spacing[axis] = v->image.direction[4 * axis] = 1;
}

void vtk_close(void *volume) {
    struct vtk_volume *v = volume;
    if (v->other.fd >= 0)
        close(v->other.fd);
    for (uint32_t i = 0; i < v->file_count; i++)
        free(v->files[i]);
    free(v->files);
    free(v->pieces);
    free(v->entries);
    for (int axis = 0; axis < 3; axis++)
        free(v->positions[axis]);
    import_mesh_parts_free(&v->mesh.parts);
}

/* sp_grow(). False with *err set if there are `most` items. */
static bool grow(const struct vtk_volume *v, void *array, size_t count, size_t size, size_t most,
                 const char *what, struct sp_error *err) {
    if (count == most)
        return sp_fail(err, SP_ERR_UNSUPPORTED, v->file->title,
                       "the file has more than %zu %s, the limit", most, what);
    return sp_grow(array, count, size) ||
           sp_fail(err, SP_ERR_MEMORY, v->file->title, "out of memory for %zu %s", count + 1, what);
}

struct vtk_piece *vtk_add_piece(struct vtk_volume *v, uint32_t file, struct sp_error *err) {
    if (!grow(v, &v->pieces, v->piece_count, sizeof *v->pieces, PIECES_MAX, "pieces", err))
        return NULL;
    struct vtk_piece *piece = &v->pieces[v->piece_count++];
    *piece = (struct vtk_piece){ .file = file, .entries = v->entry_count };
    return piece;
}

struct vtk_entry *vtk_add_entry(struct vtk_volume *v, enum vtk_home home, const char *name,
                                struct sp_error *err) {
    if (!grow(v, &v->entries, v->entry_count, sizeof *v->entries, ENTRIES_MAX, "arrays", err))
        return NULL;
    struct vtk_entry *entry = &v->entries[v->entry_count++];
    *entry = (struct vtk_entry){ .home = home, .role = VTK_ANY };
    import_name(entry->name, name);
    v->pieces[v->piece_count - 1].entry_count++;
    return entry;
}

uint32_t vtk_add_file(struct vtk_volume *v, const char *name, struct sp_error *err) {
    if (!grow(v, &v->files, v->file_count, sizeof *v->files, FILES_MAX, "files", err))
        return 0;
    v->files[v->file_count] = strdup(name);
    if (!v->files[v->file_count]) {
        sp_fail(err, SP_ERR_MEMORY, v->file->title, "out of memory for the names of files");
        return 0;
    }
    return ++v->file_count;
}

const struct import_file *vtk_open_file(struct vtk_volume *v, uint32_t number,
                                        struct sp_error *err) {
    if (number == 0)
        return v->file;
    if (v->other.fd >= 0 && v->other_number == number)
        return &v->other;
    if (v->other.fd >= 0)
        close(v->other.fd);
    const char *name = v->files[number - 1];
    char path[2 * PATH_MAX];
    const int n = snprintf(path, sizeof path, "%s/%s", name[0] == '/' ? "" : v->file->folder, name);
    v->other = *v->file;
    v->other.fd = -1;
    if (n >= PATH_MAX) {
        sp_fail(err, SP_ERR_INVALID, v->file->title,
                "the name %.80s… of a piece and its folder are longer than a path may be", name);
        return NULL;
    }
    v->other.fd = sp_open_confined(v->file->root, path, name, v->other_real, &v->other.size, err);
    if (v->other.fd < 0) {
        sp_tell_namer(err, v->file->title);
        return NULL;
    }
    snprintf(v->other_folder, sizeof v->other_folder, "%s", v->other_real);
    *strrchr(v->other_folder, '/') = 0;
    v->other.folder = v->other_folder[0] ? v->other_folder : "/";
    v->other.title = name;
    v->other.opening = NULL;
    v->other_number = number;
    return &v->other;
}

struct vtk_entry *vtk_find_entry(const struct vtk_volume *v, const struct vtk_piece *piece,
                                 enum vtk_home home, unsigned part, const char *name) {
    for (size_t i = 0; i < piece->entry_count; i++) {
        struct vtk_entry *e = &v->entries[piece->entries + i];
        if (e->home == home && e->part == part && (!name || strcmp(e->name, name) == 0))
            return e;
    }
    return NULL;
}

bool vtk_is_ghosts(const struct vtk_entry *e) {
    return strcmp(e->name, "vtkGhostType") == 0 || strcmp(e->name, "vtkGhostLevels") == 0;
}

/* True if the list ", A, B" has the name. */
static bool has_name(const char *list, const char *name) {
    const size_t n = strlen(name);
    for (const char *at = strstr(list, ", "); at; at = strstr(at + 2, ", "))
        if (strncmp(at + 2, name, n) == 0 && (!at[2 + n] || strncmp(at + 2 + n, ", ", 2) == 0))
            return true;
    return false;
}

void vtk_note_cells(struct vtk_volume *v, const char *name) {
    const char *wanted = *v->file->field ? v->file->field : v->file->vectors;
    v->wants_cells |= *wanted && strcmp(name, wanted) == 0;
    if (!v->cells.text)
        import_list_begin(&v->cells, v->cell_names, sizeof v->cell_names);
    const bool is_again = v->piece_count > 1 && v->cells.left_out > 0; /* as a rule */
    if (strncmp(name, "vtkGhost", 8) != 0 && !is_again && !has_name(v->cell_names, name))
        import_list_add(&v->cells, ", ", name);
}

void vtk_warn_of_cells(const struct vtk_volume *v, uint64_t count) {
    import_warn(v->file->warnings,
                "The %" PRIu64
                " cells of the unstructured grid are not read; its points are drawn.",
                count);
}

bool vtk_complete(struct vtk_volume *v, struct import_header *header, struct sp_error *err) {
    if (isfinite(v->time)) {
        header->steps.count = 1;
        header->steps.times = &v->time;
    }
    static const char remedy[] =
        "turn them into data of points, with ParaView's filter \"Cell Data "
        "to Point Data\" (vtkCellDataToPointData)";
    if (v->wants_cells)
        return sp_fail(
            err, SP_ERR_UNSUPPORTED, v->file->title,
            "\"%.60s\" are data of cells, which are read of images and rectilinear grids "
            "only; %s",
            *v->file->field ? v->file->field : v->file->vectors, remedy);
    if (v->cells.text)
        import_list_end(&v->cells, false);
    if (v->cell_names[0])
        import_warn(v->file->warnings, "The data of cells (%s) are not read; %s.",
                    v->cell_names + 2, remedy);
    return vtk_has_points(v->set) ? vtk_points_open(v, header, err) : vtk_grid_open(v, header, err);
}
