/* SPDX-License-Identifier: Apache-2.0
 *
 * Meshes in STL, OBJ, glTF and PLY, and lines that become tubes. The test writes the files itself.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/sanitized.h"
#include "unit/data/import/support.h"

static const float corners[5][3] = {
    { 0, 0, 0 }, { 2, 0, 0 }, { 2, 3, 0 }, { 0, 3, 0 }, { 1, 1.5f, 4 }
};
/* A pyramid without its base. */
static const uint32_t sides[4][3] = { { 0, 1, 4 }, { 1, 2, 4 }, { 2, 3, 4 }, { 3, 0, 4 } };

#define FACET                                                                                      \
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 "                      \
    "0\nendloop\nendfacet\n"

static const struct sp_elements *mesh_of(const struct sp_volume *volume) {
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_non_null(e);
    assert_int_equal(e->shape.kind, SP_KIND_MESH);
    return e;
}

/* Asserts that the mesh has the triangles of the pyramid, in any order, each with any first
 * corner. */
static void assert_pyramid(const struct sp_elements *e) {
    unsigned found = 0;
    assert_int_equal(e->shape.count, 4);
    for (uint32_t t = 0; t < 4; t++)
        for (int side = 0; side < 4; side++)
            for (int turn = 0; turn < 3; turn++) {
                bool is_same = true;
                for (int k = 0; k < 3; k++)
                    for (int a = 0; a < 3; a++)
                        is_same = is_same && fabsf(e->positions[e->triangles[t][k]][a] -
                                                   corners[sides[side][(k + turn) % 3]][a]) < 1e-5f;
                found |= is_same ? 1u << side : 0;
            }
    assert_int_equal(found, 15);
}

static void assert_close(double got, double wanted) {
    assert_compare(fabs(got - wanted), <, 1e-3);
}

static void assert_colors(const struct sp_elements *e, const double wanted[4]) {
    for (uint32_t i = 0; i < e->shape.vertex_count; i++)
        for (int c = 0; c < 4; c++)
            assert_close((double)e->colors[i][c], wanted[c]);
}

static void write_binary_stl(const char *name, uint32_t claimed) {
    unsigned char bytes[84 + 4 * 50] = "pyramid";
    memcpy(bytes + 80, &claimed, 4);
    for (int t = 0; t < 4; t++)
        for (int k = 0; k < 3; k++)
            memcpy(bytes + 84 + 50 * t + 12 * (k + 1), corners[sides[t][k]], 12);
    write_file(name, bytes, sizeof bytes);
}

static void stl_is_read(void **state) {
    (void)state;
    write_binary_stl("binary.stl", 4);
    struct sp_volume *volume = load("binary.stl");
    assert_pyramid(mesh_of(volume));
    assert_colors(mesh_of(volume), (double[]){ 0.8, 0.8, 0.8, 1 });
    assert_true(mesh_of(volume)->shape.lacks_colors);
    sp_volume_unref(&volume);
    char text[4096] = "solid pyramid\n";
    for (int t = 0; t < 4; t++) {
        size_t n = strlen(text);
        n += (size_t)snprintf(text + n, sizeof text - n, " facet normal 0 0 0\n  outer loop\n");
        for (int k = 0; k < 3; k++) {
            const float *p = corners[sides[t][k]];
            n += (size_t)snprintf(text + n, sizeof text - n, "   vertex %g %g %g\n", (double)p[0],
                                  (double)p[1], (double)p[2]);
        }
        snprintf(text + n, sizeof text - n, "  endloop\n endfacet\n");
    }
    strcat(text, "endsolid pyramid\n");
    write_text("text.STL", "%s", text);
    volume = load("text.STL");
    assert_pyramid(mesh_of(volume));
    sp_volume_unref(&volume);
}

/* A grid of small bumps as a soup of triangles: normals are smooth across common edges, but not
 * across edges with a right angle. */
static void stl_gets_normals(void **state) {
    (void)state;
    static const float roof[6][3] = { { 0, 0, 0 }, { 1, 0, 0.1f }, { 2, 0, 0 },
                                      { 0, 2, 0 }, { 1, 2, 0.1f }, { 2, 2, 0 } };
    static const int faces[5][3] = {
        { 0, 1, 4 }, { 0, 4, 3 }, { 1, 2, 5 }, { 1, 5, 4 }, { 0, 3, 3 }
    };
    unsigned char bytes[84 + 5 * 50] = "roof";
    memcpy(bytes + 80, &(uint32_t){ 5 }, 4);
    for (int t = 0; t < 5; t++)
        for (int k = 0; k < 3; k++) {
            float p[3];
            memcpy(p, roof[faces[t][k]], sizeof p);
            p[2] -= t == 4 && k == 2 ? 3 : 0; /* a wall below the edge x = 0 */
            memcpy(bytes + 84 + 50 * t + 12 * (k + 1), p, 12);
        }
    write_file("roof.stl", bytes, sizeof bytes);
    struct sp_volume *volume = load("roof.stl");
    const struct sp_elements *e = mesh_of(volume);
    int ridge = 0, walls = 0;
    for (uint32_t i = 0; i < e->shape.vertex_count; i++) {
        const float *n = e->normals[i];
        assert_close(sqrt((double)(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])), 1);
        if (fabsf(e->positions[i][0] - 1) < 1e-5f) {
            assert_compare(fabsf(n[0]), <, 0.05f);
            ridge++;
        }
        walls += fabsf(n[0]) > 0.99f;
    }
    assert_compare(ridge, >=, 2);
    assert_int_equal(walls, 3);
    sp_volume_unref(&volume);
}

static void write_obj(const char *name, const char *head, const char *tail) {
    char text[1024] = "";
    for (int i = 0; i < 5; i++) {
        size_t n = strlen(text);
        snprintf(text + n, sizeof text - n, "v %g %g %g\n", (double)corners[i][0],
                 (double)corners[i][1], (double)corners[i][2]);
    }
    write_text(name, "%s%s%s", head, text, tail);
}

static void obj_is_read_with_its_materials(void **state) {
    (void)state;
    const char *faces = "usemtl glass\nf 1 2 5\nf 2 3 5\nf -3 -2 -1\nf 4 1 5\n";
    write_text("colors.mtl", "newmtl glass\nKd 0.25 0.5 0.75\nd 0.4\n");
    write_obj("pyramid.obj", "mtllib colors.mtl\n", faces);
    struct sp_volume *volume = load("pyramid.obj");
    assert_pyramid(mesh_of(volume));
    assert_colors(mesh_of(volume), (double[]){ 0.25, 0.5, 0.75, 0.4 });
    assert_false(mesh_of(volume)->shape.lacks_colors);
    sp_volume_unref(&volume);
    /* If a library is missing or may not be read, assimp's grey remains. */
    write_obj("plain.obj", "mtllib ../../../../../../etc/hostname\nmtllib none.mtl\n", faces);
    volume = load("plain.obj");
    assert_pyramid(mesh_of(volume));
    assert_colors(mesh_of(volume), (double[]){ 0.6, 0.6, 0.6, 1 });
    sp_volume_unref(&volume);
    write_obj("quad.obj", "", "f 1 2 3 4\n");
    volume = load("quad.obj");
    assert_int_equal(mesh_of(volume)->shape.count, 2);
    assert_true(mesh_of(volume)->shape.lacks_colors);
    sp_volume_unref(&volume);
}

/* A glTF of the pyramid whose bytes are in `uri`, or behind the text of a .glb. */
static int make_gltf(char *text, size_t capacity, const char *uri, const char *indices) {
    return snprintf(
        text, capacity,
        "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
        "\"nodes\":[{\"mesh\":0,\"translation\":[0,0,0]}],"
        "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.2140,1,0,0.5]},"
        "\"alphaMode\":\"BLEND\"}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,"
        "\"material\":0}]}],"
        "\"buffers\":[{%s\"byteLength\":108}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteOffset\":0,\"byteLength\":60},"
        "{\"buffer\":0,\"byteOffset\":60,\"byteLength\":48}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":5,\"type\":\"VEC3\","
        "\"min\":[0,0,0],\"max\":[2,3,4]},{\"bufferView\":1,\"componentType\":5125,%s,"
        "\"type\":\"SCALAR\"}]}",
        uri, indices);
}

static void gltf_is_read(void **state) {
    (void)state;
    const double color[4] = { 0.5, 1, 0, 0.5 }; /* 0.214 in linear light */
    unsigned char data[108];
    char text[2048];
    memcpy(data, corners, 60);
    memcpy(data + 60, sides, 48);
    write_file("pyramid.bin", data, sizeof data);
    make_gltf(text, sizeof text, "\"uri\":\"pyramid.bin\",", "\"count\":12");
    write_text("pyramid.gltf", "%s", text);
    struct sp_volume *volume = load("pyramid.gltf");
    assert_pyramid(mesh_of(volume));
    assert_colors(mesh_of(volume), color);
    sp_volume_unref(&volume);
    struct {
        uint32_t head[5];
        char json[1600];
        uint32_t chunk[2];
        unsigned char bytes[108];
    } glb = { .head = { 0x46546c67, 2, sizeof glb, sizeof glb.json, 0x4e4f534a },
              .chunk = { sizeof glb.bytes, 0x004e4942 } };
    memset(glb.json, ' ', sizeof glb.json);
    int n = make_gltf(text, sizeof text, "", "\"count\":12");
    assert_compare(n, <, (int)sizeof glb.json);
    memcpy(glb.json, text, (size_t)n);
    memcpy(glb.bytes, data, sizeof data);
    write_file("pyramid.glb", &glb, sizeof glb);
    volume = load("pyramid.glb");
    assert_pyramid(mesh_of(volume));
    assert_colors(mesh_of(volume), color);
    sp_volume_unref(&volume);
}

/* Sixteen triangles between two rings, and six for each end. */
static void lines_become_tubes(void **state) {
    (void)state;
    write_obj("line.obj", "", "l 1 2 3\nl 4 5\n");
    struct sp_volume *volume = load("line.obj");
    const struct sp_elements *e = mesh_of(volume);
    const double radius = sqrt(4 + 9 + 16) / 400;
    assert_int_equal(e->shape.vertex_count, 8 * 5);
    assert_int_equal(e->shape.count, 3 * 16 + 2 * 12);
    for (uint32_t i = 0; i < e->shape.vertex_count; i++) {
        const float *p = e->positions[i], *center = corners[i / 8];
        double square = 0, across = 0;
        for (int a = 0; a < 3; a++) {
            const double off = (double)(p[a] - center[a]);
            square += off * off;
            across += off * (double)e->normals[i][a];
        }
        assert_close(sqrt(square), radius);
        assert_close(across, radius);
    }
    for (int i = 0; i < 8; i++) /* the first line starts along x */
        assert_close((double)e->positions[i][0], 0);
    sp_volume_unref(&volume);
}

static void ply_is_read(void **state) {
    (void)state;
    write_text("colors.ply", "ply\nformat ascii 1.0\nelement vertex 5\n"
                             "property float x\nproperty float y\nproperty float z\n"
                             "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                             "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
                             "0 0 0 255 0 51\n2 0 0 255 0 51\n2 3 0 255 0 51\n0 3 0 255 0 51\n"
                             "1 1.5 4 255 0 51\n3 0 1 4\n4 0 1 2 3\n2 0 1\n");
    struct sp_volume *volume = load("colors.ply");
    const struct sp_elements *e = mesh_of(volume);
    assert_int_equal(e->shape.count, 3);
    assert_colors(e, (double[]){ 1, 0, 0.2, 1 });
    assert_false(e->shape.lacks_colors);
    /* The side and the bottom meet at an edge of more than 40°, and share no vertices. */
    assert_int_equal(e->shape.vertex_count, 7);
    static const float places[3][2] = { { 0, 0 }, { 2, 3 }, { 0, 3 } };
    for (int k = 0; k < 3; k++) {
        const uint32_t v = e->triangles[2][k];
        assert_float_equal(e->positions[v][0], places[k][0], 0);
        assert_float_equal(e->positions[v][1], places[k][1], 0);
        assert_compare(fabsf(e->normals[v][2]), >, 0.99f);
        assert_compare(fabsf(e->normals[e->triangles[0][k]][2]), <, 0.5f);
    }
    sp_volume_unref(&volume);
    write_text("empty.ply", "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\n"
                            "property float y\nproperty float z\nelement face 0\n"
                            "property list int int vertex_index\nend_header\n");
    volume = load("empty.ply");
    assert_true(mesh_of(volume)->shape.lacks_colors);
    assert_int_equal(mesh_of(volume)->shape.count, 0);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "The file has no triangles, so nothing is drawn.");
    sp_volume_unref(&volume);
    write_text("far.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                          "property float y\nproperty float z\nelement face 1\n"
                          "property list int int vertex_index\nend_header\n"
                          "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n");
    load_error("far.ply", SP_ERR_FORMAT, "far.ply", "is not in the file, in face 0");
    write_text("none.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                           "property float y\nproperty float z\nelement face 1\n"
                           "property int vertex_index\nend_header\n0 0 0\n0\n");
    load_error("none.ply", SP_ERR_UNSUPPORTED, "none.ply", "no list");
}

/* assimp names no place. */
static void errors_of_stl_name_the_place(void **state) {
    (void)state;
    const char *facet = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 %s\n";
    write_text("word.stl", facet, "x 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid");
    load_error("word.stl", SP_ERR_FORMAT, "word.stl: line 5", "\"x\" stands where a number is");
    write_text("cut.stl", facet, "0 0");
    load_error("cut.stl", SP_ERR_FORMAT, "cut.stl: line 6", "ends inside of a facet");
    write_text("tiny.stl", "soli");
    load_error("tiny.stl", SP_ERR_FORMAT, "tiny.stl: byte 0", "at least 84");
}

static void odd_stl_files_are_read(void **state) {
    (void)state;
    static const unsigned char none[84] = { 0 };
    write_binary_stl("odd.stl", 4);
    FILE *file = fopen(in_folder("odd.stl"), "ab");
    assert_non_null(file);
    assert_int_equal(fwrite("more", 1, 4, file), 4);
    fclose(file);
    struct sp_volume *volume = load("odd.stl");
    assert_int_equal(mesh_of(volume)->shape.count, 4);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "The file goes on after its last triangle; these 4 bytes are not read.");
    sp_volume_unref(&volume);
    write_file("none.stl", none, sizeof none);
    volume = load("none.stl");
    assert_int_equal(mesh_of(volume)->shape.count, 0);
    sp_volume_unref(&volume);
}

/* A valid file may have nothing to draw. */
static void files_without_triangles_are_empty(void **state) {
    static const char *const files[][2] = {
        { "empty.stl", "solid x\nendsolid x\n" },
        { "solids.stl", "solid x\nendsolid x\nsolid\nendsolid" },
        { "points.obj", "o a\nv 0 0 0\r\nv 1 0 0\np 1 2\n" },
        { "comment.obj", "# nothing\n\n" },
        { "bare.gltf", "{\"asset\":{\"version\":\"2.0\"}}" },
        { "lists.gltf", "{\"asset\":{\"version\":\"2.0\"},\"scenes\":[],\"meshes\":[]}" },
        { "node.gltf", "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
                       "\"nodes\":[{\"name\":\"camera\"}]}" },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text(files[i][0], "%s", files[i][1]);
        struct sp_volume *volume = load(files[i][0]);
        assert_int_equal(mesh_of(volume)->shape.count, 0);
        assert_string_equal(sp_volume_info(volume)->warnings[0],
                            "The file has no triangles, so nothing is drawn.");
        sp_volume_unref(&volume);
    }
    write_text("half.stl", "solid x\nendsolid x\nsolid y\n" FACET "endsolid y\n");
    struct sp_volume *volume = load("half.stl");
    assert_int_equal(mesh_of(volume)->shape.count, 1);
    assert_string_equal(sp_volume_info(volume)->warnings[0], "");
    sp_volume_unref(&volume);
    write_text("cut.stl", "solid x\n");
    load_error("cut.stl", SP_ERR_FORMAT, "cut.stl: line 2", "is cut off");
    write_text("old.gltf", "{\"asset\":{\"version\":\"1.0\"},\"meshes\":{\"a\":{}}}");
    load_error("old.gltf", SP_ERR_FORMAT, "old.gltf", "");
}

/* assimp follows nested brackets and nodes until the stack ends. */
static void nested_gltf_is_refused(void **state) {
    (void)state;
    enum { DEEP = 3000 };
    static char text[64 * DEEP];
    memset(text, '[', 100000);
    text[100000] = 0;
    write_text("brackets.gltf", "%s", text);
    load_error("brackets.gltf", SP_ERR_FORMAT, "brackets.gltf: byte 2049", "depth");
    size_t at = (size_t)sprintf(text, "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[");
    for (int i = 1; i < DEEP; i++)
        at += (size_t)sprintf(text + at, "{\"children\":[%d]},", i);
    sprintf(text + at, "{}]}");
    write_text("deep.gltf", "%s", text);
    load_error("deep.gltf", SP_ERR_UNSUPPORTED, "deep.gltf", "fewer levels");
    write_text("twice.gltf", "{\"nodes\":[{\"children\":[1,1]},{}]}");
    load_error("twice.gltf", SP_ERR_FORMAT, "twice.gltf", "must be a tree");
}

static void files_that_lie_are_refused(void **state) {
    (void)state;
    char text[2048];
    write_binary_stl("long.stl", 400000000);
    load_error("long.stl", SP_ERR_FORMAT, "long.stl: byte 80: triangles", "is cut off or");
    write_obj("far.obj", "", "f 1 2 4000000000\nf 1 2 3\nf 1 2 900\n");
    load_error("far.obj", SP_ERR_FORMAT, "far.obj: line", "does not exist: \"4000000000\"");
    write_obj("surface.obj", "", "surf 0 1 0 1 1 2 3\n");
    load_error("surface.obj", SP_ERR_FORMAT, "surface.obj", "no faces and no lines");
    make_gltf(text, sizeof text, "\"uri\":\"none.bin\",", "\"count\":12");
    write_text("missing.gltf", "%s", text);
    load_error("missing.gltf", SP_ERR_FORMAT, "missing.gltf", "none.bin");
    make_gltf(text, sizeof text, "\"uri\":\"../../../../etc/passwd\",", "\"count\":12");
    write_text("outside.gltf", "%s", text);
    load_error("outside.gltf", SP_ERR_FORMAT, "outside.gltf", "passwd");
    make_gltf(text, sizeof text, "\"uri\":\"pyramid.bin\",", "\"count\":1200000000");
    write_text("count.gltf", "%s", text);
    load_error("count.gltf", SP_ERR_FORMAT, "count.gltf", "");
    write_text("empty.glb", "glTF");
    load_error("empty.glb", SP_ERR_FORMAT, "empty.glb", "");
    write_text("noise.obj", "%s", "\x01\x02 f f f 9/9/9 v");
    load_error("noise.obj", SP_ERR_FORMAT, "noise.obj", "");
}

/* 2.4 GB of zeros, of which the file has one vertex. */
static void memory_that_runs_out_is_told(void **state) {
    (void)state;
    if (TEST_SANITIZED) {
        print_message("skipped: under a sanitizer the memory of a process has no limit\n");
        skip();
    }
    write_text("huge.gltf",
               "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
               "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":"
               "{\"POSITION\":0}}]}],\"buffers\":[{\"byteLength\":12,\"uri\":"
               "\"data:application/octet-stream;base64,AAAAAAAAAAAAAAAA\"}],"
               "\"bufferViews\":[{\"buffer\":0,\"byteLength\":12}],"
               "\"accessors\":[{\"componentType\":5126,\"count\":200000000,\"type\":\"VEC3\","
               "\"sparse\":{\"count\":1,\"indices\":{\"bufferView\":0,\"componentType\":5125},"
               "\"values\":{\"bufferView\":0}}}]}");
    load_error("huge.gltf", SP_ERR_MEMORY, "huge.gltf", "1 GiB");
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(stl_is_read),
                                        cmocka_unit_test(stl_gets_normals),
                                        cmocka_unit_test(obj_is_read_with_its_materials),
                                        cmocka_unit_test(gltf_is_read),
                                        cmocka_unit_test(ply_is_read),
                                        cmocka_unit_test(lines_become_tubes),
                                        cmocka_unit_test(errors_of_stl_name_the_place),
                                        cmocka_unit_test(odd_stl_files_are_read),
                                        cmocka_unit_test(files_without_triangles_are_empty),
                                        cmocka_unit_test(nested_gltf_is_refused),
                                        cmocka_unit_test(files_that_lie_are_refused),
                                        cmocka_unit_test(memory_that_runs_out_is_told) };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
