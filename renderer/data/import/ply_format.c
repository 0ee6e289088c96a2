/* SPDX-License-Identifier: Apache-2.0
 *
 * PLY files as the importer sees them: the first kind of content that the header matches.
 */
#include <stdlib.h>
#include <string.h>

#include "data/import/ply.h"

struct reader {
    struct ply ply;
    const struct ply_content *content;
};

static const struct ply_content *const contents[] = { &ply_packed_gaussians, &ply_gaussians,
                                                      &ply_points, &ply_mesh };

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)title;
    return size >= 4 && memcmp(start, "ply", 3) == 0 && (start[3] == '\n' || start[3] == '\r');
}

/* Says why the vertices have no place. True if they have one, or if there are none. */
static bool check_places(const struct reader *r, struct sp_error *err) {
    static const char *const names[] = { "x", "y", "z" };
    const struct ply *ply = &r->ply;
    const struct ply_element *vertex = ply_find(ply, "vertex");
    for (int a = 0; vertex && a < 3; a++) {
        bool is_list = false;
        if (ply_column(ply, vertex, names[a]) >= 0)
            continue;
        for (unsigned i = 0; i < vertex->properties; i++)
            is_list |= strcmp(ply->properties[vertex->first + i].name, names[a]) == 0;
        return import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, "vertex",
                           "the property %s is %s; vertices need the numbers x, y and z", names[a],
                           is_list ? "a list" : "missing");
    }
    return true;
}

static bool open_ply(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct reader *r = reader;
    if (!ply_parse(&r->ply, file, err))
        return false;
    for (size_t i = 0; i < sizeof contents / sizeof *contents && !r->content; i++)
        if (contents[i]->matches(&r->ply))
            r->content = contents[i];
    if (r->content)
        return r->content->open(&r->ply, header, err);
    return check_places(r, err) &&
           import_fail(err, SP_ERR_UNSUPPORTED, r->ply.file->title, r->ply.begin, "element",
                       "the file has neither Gaussians, points nor a mesh: an element \"vertex\" "
                       "with the properties x, y and z");
}

static void close_ply(void *reader) {
    struct reader *r = reader;
    import_mesh_free(&r->ply.mesh);
}

static bool read_elements(void *reader, const struct sp_elements *elements,
                          const struct import_progress *progress, struct sp_error *err) {
    const struct reader *r = reader;
    return r->content->read(&r->ply, elements, progress, err);
}

const struct import_format import_ply = { .name = "PLY",
                                          .probe = probe,
                                          .reader_size = sizeof(struct reader),
                                          .open = open_ply,
                                          .read_elements = read_elements,
                                          .close = close_ply };
