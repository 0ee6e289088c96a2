/* SPDX-License-Identifier: Apache-2.0
 *
 * The decoder as a program, for scripts. Each line of standard input is an array of patches; they
 * are applied in order to the fixture's default view. Each line of standard output is {"view": …},
 * or
 * {"error": {"code", "pointer", "text"}} for the first refused patch.
 */
#include <stdio.h>
#include <stdlib.h>

#include "protocol/fixture.h"
#include "protocol/view.h"

static proto_json *answer_line(const char *line, size_t size) {
    struct sp_error err = { 0 };
    const struct sp_view defaults = fixture_view();
    struct sp_view view = defaults;
    proto_json *patches = proto_json_parse(line, size, &err), *answer = proto_json_object();
    bool ok = patches != NULL;
    for (size_t i = 0; ok && i < proto_json_size(patches); i++)
        ok = proto_view_apply(proto_json_at(patches, i), &defaults, &view, &err);
    proto_json_free(&patches);
    if (ok) {
        proto_json_set(&answer, "view", proto_view_encode(&view));
        return answer;
    }
    proto_json *error = proto_json_object();
    proto_json_set_string(&error, "code", sp_code_name(err.code));
    proto_json_set_string(&error, "pointer", err.place);
    proto_json_set_string(&error, "text", err.text);
    proto_json_set(&answer, "error", error);
    return answer;
}

int main(void) {
    char *line = NULL;
    size_t capacity = 0;
    for (ssize_t n; (n = getline(&line, &capacity, stdin)) > 0;) {
        proto_json *answer = answer_line(line, (size_t)n);
        char *text = proto_json_to_canonical(answer, NULL);
        if (!text)
            return 1;
        printf("%s\n", text);
        fflush(stdout);
        free(text);
        proto_json_free(&answer);
    }
    free(line);
    return 0;
}
