/* SPDX-License-Identifier: Apache-2.0
 *
 * Tokens that change while their sessions and streams exist.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "unit/server/session/hub_fixture.h"

/* Creates a session of this owner, which replaces the fixture's. The session without owner stays.
 */
static void create_owned(struct fixture *f, const struct srv_owner *owner) {
    proto_json *json = srv_hub_session_create(f->hub, NULL, owner, false, 0, f->id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
}

/* Returns the code that closes the participant's stream; 0 = it is not closed. */
static unsigned close_code(struct fixture *f, struct srv_participant *p) {
    struct srv_message message;
    enum srv_message_kind kind;
    while ((kind = srv_hub_next_message(f->hub, p, SRV_NEXT_NOTIFICATIONS, 0, &message)) ==
           SRV_MESSAGE_TEXT)
        free(message.text);
    return kind == SRV_MESSAGE_CLOSE ? message.close_code : 0;
}

static void a_removed_token_closes_its_streams(void **state) {
    struct fixture *f = *state;
    const struct srv_owner ann = { .name = "ann" };
    struct srv_quota current = { .sessions = 0 };
    struct sp_error err;
    struct srv_participant *p[4];
    p[0] = srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "", NULL, 0,
                        &err); /* of the session without owner */
    f->quota = &current;
    f->rights = SRV_RIGHT_VIEW;
    p[1] = srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "ann", NULL, 0, &err);
    create_owned(f, &ann);
    p[2] = srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "", NULL, 0, &err);
    p[3] = srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "ann", NULL, 0, &err);
    for (int is_gone = 0; is_gone < 2; is_gone++) {
        srv_hub_renew_tokens(f->hub);
        for (int i = 0; i < 4; i++)
            assert_int_equal(close_code(f, p[i]), is_gone && i > 0 ? 1008 : 0);
        f->quota = NULL;
    }
    /* A client with a join token may join again: only the change itself closes streams. */
    struct srv_participant *again = srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "", NULL, 0, &err);
    assert_non_null(again);
    srv_hub_renew_tokens(f->hub);
    assert_int_equal(close_code(f, again), 0);
    /* A token that was removed before the client joins gives no access. */
    assert_null(srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "ann", NULL, 0, &err));
    assert_int_equal(err.code, SP_ERR_DENIED);
    srv_hub_leave(f->hub, &again, 0);
    for (int i = 0; i < 4; i++)
        srv_hub_leave(f->hub, &p[i], 0);
}

/* The current rights of a token decide on its streams: in sessions of its own, and in sessions
 * without owner, where an admin has control. */
static void a_lowered_role_closes_its_streams(void **state) {
    struct fixture *f = *state;
    enum { CONTROL = SRV_RIGHT_VIEW | SRV_RIGHT_RENDER | SRV_RIGHT_CONTROL };
    static const struct {
        bool is_own;
        enum srv_role role;
        unsigned before, after;
        unsigned code;
    } cases[] = {
        { true, SRV_ROLE_CONTROL, CONTROL, CONTROL, 0 },
        { true, SRV_ROLE_CONTROL, CONTROL, SRV_RIGHT_VIEW | SRV_RIGHT_RENDER, 1008 },
        { true, SRV_ROLE_VIEW, CONTROL, SRV_RIGHT_VIEW, 0 },
        { true, SRV_ROLE_VIEW, SRV_RIGHT_VIEW, SRV_RIGHT_METRICS, 1008 },
        { false, SRV_ROLE_CONTROL, CONTROL | SRV_RIGHT_ADMIN, CONTROL, 1008 },
        { false, SRV_ROLE_VIEW, CONTROL, SRV_RIGHT_VIEW, 0 },
    };
    const struct srv_owner ann = { .name = "ann" };
    struct srv_quota current = { .sessions = 0 };
    struct sp_error err;
    char without_owner[sizeof f->id];
    memcpy(without_owner, f->id, sizeof f->id);
    f->quota = &current;
    create_owned(f, &ann);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *id = cases[i].is_own ? f->id : without_owner;
        f->rights = cases[i].before;
        struct srv_participant *p = srv_hub_join(f->hub, id, cases[i].role, "ann", NULL, 0, &err);
        struct srv_participant *joined =
            srv_hub_join(f->hub, id, SRV_ROLE_CONTROL, "", NULL, 0, &err);
        assert_non_null(p);
        assert_non_null(joined);
        f->rights = cases[i].after;
        srv_hub_renew_tokens(f->hub);
        print_message("case %zu\n", i);
        assert_int_equal(close_code(f, p), cases[i].code);
        assert_int_equal(close_code(f, joined), 0);
        struct srv_participant *late =
            srv_hub_join(f->hub, id, cases[i].role, "ann", NULL, 0, &err);
        assert_int_equal(late == NULL, cases[i].code != 0);
        srv_hub_leave(f->hub, &late, 0);
        srv_hub_leave(f->hub, &joined, 0);
        srv_hub_leave(f->hub, &p, 0);
    }
}

/* Applies a patch and returns the code of the error; SP_OK = it was merged. */
static enum sp_code patched(struct fixture *f, const char *text) {
    struct sp_error err = { .code = SP_OK };
    proto_json *patch = proto_json_parse(text, strlen(text), NULL);
    proto_json *view = srv_hub_session_patch(f->hub, f->id, patch, 0, &err);
    assert_int_equal(view == NULL, err.code != SP_OK);
    proto_json_free(&view);
    proto_json_free(&patch);
    return err.code;
}

/* Gets the size of the next frame of the only participant. */
static void next_size(struct fixture *f, uint32_t size[2]) {
    struct srv_render_job job;
    double wait_ms;
    static double now_ms = 1e6;
    now_ms += 10000;
    assert_true(srv_schedule_next(f->schedule, now_ms, &job, &wait_ms));
    memcpy(size, job.full, sizeof job.full);
    srv_schedule_cancelled(f->schedule, &job, 0);
}

/* A lowered limit reduces the frames of an existing session. The view keeps its size, so that a
 * raised limit restores the frames. Only a patch that sets a larger size is refused. */
static void a_lowered_size_limit_reduces_frames(void **state) {
    struct fixture *f = *state;
    const struct srv_owner ann = { .name = "ann" };
    struct srv_quota current = { .sessions = 0 };
    struct sp_error err;
    uint32_t size[2];
    f->quota = &current;
    f->rights = SRV_RIGHT_VIEW;
    create_owned(f, &ann);
    assert_int_equal(patched(f, "{\"size\":[1600,400]}"), SP_OK);
    struct srv_participant *p = srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "", NULL, 0, &err);
    assert_non_null(p);
    next_size(f, size);
    assert_int_equal(size[0], 1600);
    assert_int_equal(size[1], 400);
    current.frame_px = 160000;
    srv_hub_renew_tokens(f->hub);
    assert_int_equal(patched(f, "{\"camera\":{\"fov_y\":33}}"), SP_OK);
    next_size(f, size);
    assert_int_equal(size[0], 800);
    assert_int_equal(size[1], 200);
    assert_int_equal(patched(f, "{\"size\":[1600,401]}"), SP_ERR_INVALID);
    assert_int_equal(patched(f, "{\"size\":[400,400]}"), SP_OK);
    next_size(f, size);
    assert_int_equal(size[0], 400);
    assert_int_equal(size[1], 400);
    assert_int_equal(patched(f, "{\"size\":[1600,400]}"), SP_ERR_INVALID);
    current.frame_px = 0;
    srv_hub_renew_tokens(f->hub);
    assert_int_equal(patched(f, "{\"size\":[1600,400]}"), SP_OK);
    srv_hub_leave(f->hub, &p, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_removed_token_closes_its_streams, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(a_lowered_role_closes_its_streams, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(a_lowered_size_limit_reduces_frames, hub_set_up,
                                        hub_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
