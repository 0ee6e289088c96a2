/* SPDX-License-Identifier: Apache-2.0
 *
 * Heads in the spaces of NIfTI (RAS), DICOM (LPS) and others, from file to view: each must stand
 * upright, show its face, and have its left on the right side of the image.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/view.h"
#include "splat/camera.h"
#include "unit/data/import/support.h"

enum { SIDE = 48 };

struct space {
    const char *name;
    double left, back;         /* signs of +x towards the left, and of +y towards the back */
    const struct space *world; /* of the volume; NULL = the same */
};
static const struct space dicom = { "LPS", 1, 1, NULL };
static const struct space spaces[] = { { "RAS", -1, -1, NULL },
                                       { "LPS", 1, 1, NULL },
                                       { "LAS", 1, -1, &dicom } };

/* How the slices are stored: the world axis of each axis of the grid. */
static const unsigned orders[][3] = { { 0, 1, 2 }, { 1, 2, 0 }, { 0, 2, 1 } };

/* A head around the origin: a nose in front, an ear on the left, a neck. Towards the left, the back
 * and the head. */
static uint8_t head(double l, double p, double s) {
    bool skull = l * l + p * p + s * s < 16 * 16;
    bool nose = l * l + s * s < 9 && p < 0 && p > -21;
    bool ear = p * p + s * s < 16 && l > 0 && l < 20;
    bool neck = l * l + p * p < 49 && s < 0;
    return skull || nose || ear || neck ? 180 : 3;
}

/* The world is centred: the first sample has -23.5 on each axis. */
static void make_samples(const struct space *space, const unsigned order[3],
                         uint8_t samples[SIDE * SIDE * SIDE]) {
    for (int i = 0; i < SIDE * SIDE * SIDE; i++) {
        const int at[3] = { i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE };
        double world[3];
        for (int axis = 0; axis < 3; axis++)
            world[order[axis]] = at[axis] - (SIDE - 1) / 2.0;
        samples[i] = head(space->left * world[0], space->back * world[1], world[2]);
    }
}

/* A place of the head in the image: x to the right and y down [px], then the distance. */
static struct sp_vec3 project_point(const struct sp_view *view, const struct space *space, double l,
                                    double p, double s) {
    struct sp_camera_transform camera;
    sp_camera_transform_init(&camera, &view->camera, view->size);
    struct sp_vec3 world = { { space->left * l, space->back * p, s } };
    struct sp_vec3 u = sp_mat3_apply(&camera.w, sp_vec3_sub(world, camera.eye));
    return (struct sp_vec3){ { camera.centre[0] + camera.scale * u.v[0] / u.v[2],
                               camera.centre[1] + camera.scale * u.v[1] / u.v[2], u.v[2] } };
}

static void check_head(const char *file, const struct space *space) {
    struct sp_volume *volume = load(file);
    struct sp_view view;
    if (space->world)
        space = space->world;
    assert_string_equal(sp_volume_info(volume)->anatomy, space->name);
    sp_view_choose(&view, volume, "head");
    struct sp_vec3 crown = project_point(&view, space, 0, 0, 16),
                   neck = project_point(&view, space, 0, 0, -23),
                   nose = project_point(&view, space, 0, -20, 0),
                   nape = project_point(&view, space, 0, 16, 0),
                   ear = project_point(&view, space, 19, 0, 0),
                   right = project_point(&view, space, -16, 0, 0);
    assert_compare(crown.v[1], <, neck.v[1] - 100);
    assert_compare(nose.v[2], <, nape.v[2] - 20);
    if (ear.v[0] <= right.v[0] + 100)
        fail_msg("%s in %s is mirrored", file, space->name);
    sp_volume_unref(&volume);
}

static void heads_of_every_space_stand_upright_and_face_the_camera(void **state) {
    (void)state;
    static const char *const axes[] = { "(1,0,0)", "(0,1,0)", "(0,0,1)" };
    static const char *const vectors[] = { "[1,0,0]", "[0,1,0]", "[0,0,1]" };
    static uint8_t samples[SIDE * SIDE * SIDE];
    for (size_t i = 0; i < sizeof spaces / sizeof *spaces; i++)
        for (size_t k = 0; k < sizeof orders / sizeof *orders; k++) {
            const unsigned *order = orders[k];
            char header[400];
            make_samples(&spaces[i], order, samples);
            snprintf(header, sizeof header,
                     "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 48 48 48\nencoding: raw\n"
                     "space: %s\nspace directions: %s %s %s\nspace origin: (-23.5,-23.5,-23.5)\n\n",
                     spaces[i].name, axes[order[0]], axes[order[1]], axes[order[2]]);
            write_both("head.nrrd", header, samples, sizeof samples);
            check_head("head.nrrd", &spaces[i]);
            write_file("head.raw", samples, sizeof samples);
            write_text("head.json",
                       "{\"dims\": [48, 48, 48], \"type\": \"uint8\", \"file\": \"head.raw\","
                       " \"space\": \"%s\", \"direction\": [%s, %s, %s],"
                       " \"origin\": [-23.5, -23.5, -23.5]}",
                       spaces[i].name, vectors[order[0]], vectors[order[1]], vectors[order[2]]);
            check_head("head.json", &spaces[i]);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(heads_of_every_space_stand_upright_and_face_the_camera),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
