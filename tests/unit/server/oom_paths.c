/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths without memory: from the request to the last file, and their deletion.
 */
#include "unit/server/oom.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "support/compare.h"
#include "support/fake_memory.h"

#define PATH(format)                                                                               \
    "{\"frames\":1,\"size\":[8,8],\"format\":\"" format "\",\"keyframes\":[{\"frame\":0,"          \
    "\"view\":{\"background\":[0.%ld,0,0,1]}}]}"

static void make_path(const char *body, char id[64]) {
    oom_must("POST", "paths", body, 202);
    oom_member("id", id);
}

/* Follows the events of a path until it is done or the events end; unless `is_patient`, also until
 * the path waits for memory. Fails if it waits for something else. True if it is done. */
static bool is_done(const char *id, bool is_patient) {
    char path[96];
    const char *reason = NULL;
    snprintf(path, sizeof path, "paths/%s/events", id);
    oom_http.bytes[0] = 0;
    oom_request("GET", path, "");
    while (!strstr(oom_http.bytes, "event: done") && (is_patient || !reason)) {
        if (!oom_receive(&oom_http))
            break;
        reason = strstr(oom_http.bytes, "\"reason\"");
        if (reason && strstr(reason, "\n\n") && !strstr(reason, "memory"))
            fail_msg("the path waits for something else: %.600s", oom_http.bytes);
    }
    oom_hang_up(&oom_http);
    if (strstr(oom_http.bytes, "event: failed"))
        fail_msg("the path failed: %.600s", oom_http.bytes);
    return strstr(oom_http.bytes, "event: done");
}

/* Waits for a path. First deletes another path, because a deletion makes waiting paths try again.
 */
static void wait_until_done(const char *id) {
    char text[512], other[64], path[96];
    snprintf(text, sizeof text, PATH("jpeg"), 1L);
    make_path(text, other);
    snprintf(path, sizeof path, "paths/%s", other);
    oom_must("DELETE", path, "", 204);
    assert_true(is_done(id, true));
}

/* Each allocation from the request to the last file fails once: the path waits, and is completed
 * later. */
static void each_allocation_of_drawing(void) {
    char text[512], id[64], path[128];
    size_t whole = 0;
    long n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        snprintf(text, sizeof text, PATH("webm"), 5L);
        memory_fail_at_place();
        int status = oom_ask("POST", "paths", text);
        bool is_there = false;
        if (status == 202) {
            oom_member("id", id);
            is_there = is_done(id, false);
        }
        refused = memory_restore();
        if (status != 202) {
            assert_true(refused);
            assert_true(oom_is_no_memory(status));
        }
        if (status != 202)
            make_path(text, id);
        if (!is_there)
            wait_until_done(id);
        snprintf(path, sizeof path, "paths/%s/movie", id);
        oom_must("GET", path, "", 200);
        whole = whole ? whole : oom_http.have;
        assert_int_equal(oom_http.have, whole);
        snprintf(path, sizeof path, "paths/%s", id);
        oom_must("DELETE", path, "", 204);
    }
    print_message("drawing: %ld allocations\n", n - 1);
}

static void each_allocation_of_deleting(void) {
    char text[512], id[64], path[96];
    long n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        snprintf(text, sizeof text, PATH("png"), n);
        make_path(text, id);
        wait_until_done(id);
        snprintf(path, sizeof path, "paths/%s", id);
        int status;
        refused = oom_try("DELETE", path, "", 204, &status);
        int again = oom_ask("DELETE", path, "");
        if (again != 404) {
            assert_int_equal(again, 204);
            assert_int_not_equal(status, 204);
        }
    }
    print_message("DELETE paths: %ld allocations\n", n - 1);
    assert_compare(n, >, 3);
    oom_cover("DELETE", path);
}

void oom_paths(void **state) {
    (void)state;
    static const char *const of_frames[] = { "", "/frames/0", "/archive", "/events" };
    char text[512], id[64], movie[64], path[128];
    snprintf(text, sizeof text, PATH("png"), 5L);
    make_path(text, id);
    snprintf(text, sizeof text, PATH("webm"), 5L);
    make_path(text, movie);
    wait_until_done(id);
    wait_until_done(movie);
    oom_each_allocation("POST", "paths", PATH("png"), 202);
    oom_each_allocation("GET", "paths", "", 200);
    for (size_t i = 0; i < sizeof of_frames / sizeof *of_frames; i++) {
        snprintf(path, sizeof path, "paths/%s%s", id, of_frames[i]);
        oom_each_allocation("GET", path, "", 200);
    }
    snprintf(path, sizeof path, "paths/%s/movie", movie);
    oom_each_allocation("GET", path, "", 200);
    each_allocation_of_deleting();
    each_allocation_of_drawing(); /* of a movie, which takes every step of an image except writing
                                     the file */
}
