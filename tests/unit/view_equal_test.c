/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "protocol/view_fields.h"
#include "sp/view.h"

/* Every list and every name is full, so that each byte counts, and every number is 0. */
static void fill(struct sp_view *view) {
    memset(view, 0, sizeof *view);
    memset(view->volume, 'x', sizeof view->volume - 1);
    view->transfer_function.point_count = SP_TF_POINTS_MAX;
    view->transfer_function.gradient_count = SP_GRADIENT_POINTS_MAX;
    view->shading.light_count = SP_LIGHTS_MAX;
    view->clip.plane_count = SP_CLIP_PLANES_MAX;
    view->edit_count = SP_EDITS_MAX;
    view->layer_count = SP_LAYERS_MAX;
    for (int i = 0; i < SP_LAYERS_MAX; i++) {
        memset(view->layers[i].id, 'x', SP_NAME_BYTES - 1);
        memset(view->layers[i].color_by, 'x', SP_NAME_BYTES - 1);
        view->layers[i].point_count = SP_CHANNEL_POINTS_MAX;
    }
}

static void assert_equal_view(const struct sp_view *a, const struct sp_view *b) {
    assert_true(sp_view_equal(a, b));
    assert_true(sp_view_equal(b, a));
}

static void assert_other_view(const struct sp_view *a, const struct sp_view *b) {
    assert_false(sp_view_equal(a, b));
    assert_false(sp_view_equal(b, a));
}

static bool is_in(size_t at, size_t start, size_t size) {
    return at >= start && at < start + size;
}

/* Marks the bytes of all fields of the group, which lie in the view from `start` on. */
static void mark(unsigned char *bytes, const struct proto_group *group, size_t start) {
    for (size_t i = 0; i < group->count; i++) {
        const struct proto_field *field = &group->fields[i];
        if (field->kind == PROTO_FIELD_PRIMITIVE || field->kind == PROTO_FIELD_ORBIT)
            continue;
        if (field->kind == PROTO_FIELD_OBJECT) {
            mark(bytes, field->group, start);
        } else if (field->kind == PROTO_FIELD_LIST) {
            memset(bytes + start + field->count_offset, 1, sizeof(uint32_t));
            for (size_t k = 0; k < field->item_max; k++)
                mark(bytes, field->group, start + field->offset + k * field->item_bytes);
        } else {
            memset(bytes + start + field->offset, 1, proto_field_bytes(field));
        }
    }
}

/* A field that the protocol knows and the comparison forgets fails the test. */
static void each_byte_of_each_field_counts(void **state) {
    (void)state;
    static unsigned char is_used[sizeof(struct sp_view)];
    struct sp_view a, b;
    unsigned char *bytes = (unsigned char *)&b;
    fill(&a);
    fill(&b);
    mark(is_used, &proto_view_group, 0);
    assert_equal_view(&a, &b);
    for (size_t i = 0; i < sizeof b; i++) {
        const bool is_same = is_used[i] == 0; /* padding */
        const bool is_slice = is_in(i, offsetof(struct sp_view, slices), sizeof b.slices);
        const bool is_function =
            is_in(i, offsetof(struct sp_view, transfer_function), sizeof b.transfer_function);
        bytes[i] ^= 1;
        if (sp_view_equal(&a, &b) != is_same || sp_view_equal(&b, &a) != is_same)
            fail_msg("byte %zu of a view %s", i, is_same ? "is padding" : "does not count");
        assert_int_equal(sp_view_is_same_image(&a, &b), is_same || is_slice);
        assert_int_equal(sp_transfer_function_equal(&a.transfer_function, &b.transfer_function),
                         is_same || !is_function);
        bytes[i] ^= 1;
    }
}

static void unused_entries_do_not_count(void **state) {
    (void)state;
    struct sp_view a, b;
    fill(&a);
    a.layers[0].point_count--;
    a.transfer_function.point_count--;
    a.transfer_function.gradient_count--;
    a.shading.light_count--;
    a.clip.plane_count--;
    a.edit_count--;
    a.layer_count--;
    b = a;
    b.layers[0].points[SP_CHANNEL_POINTS_MAX - 1].value = 1;
    b.transfer_function.points[SP_TF_POINTS_MAX - 1].value = 1;
    b.transfer_function.gradient[SP_GRADIENT_POINTS_MAX - 1].magnitude = 1;
    b.shading.lights[SP_LIGHTS_MAX - 1].space = SP_LIGHT_WORLD;
    b.clip.planes[SP_CLIP_PLANES_MAX - 1].offset = 1;
    b.edits[SP_EDITS_MAX - 1].radius = 1;
    b.layers[SP_LAYERS_MAX - 1].value = 1;
    assert_equal_view(&a, &b);
    strcpy(a.volume, "head");
    strcpy(b.volume, "head");
    assert_equal_view(&a, &b);
    strcpy(b.volume, "heart");
    assert_other_view(&a, &b);
}

static void numbers_are_compared_by_value(void **state) {
    (void)state;
    struct sp_view a, b;
    fill(&a);
    fill(&b);
    a.filter.c_max = NAN;
    b.filter.c_max = -NAN;
    assert_equal_view(&a, &b);
    b.filter.c_max = 0;
    assert_other_view(&a, &b);
    b.filter.c_max = NAN;
    b.camera.position[1] = -0.0;
    assert_other_view(&a, &b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_byte_of_each_field_counts),
        cmocka_unit_test(unused_entries_do_not_count),
        cmocka_unit_test(numbers_are_compared_by_value),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
