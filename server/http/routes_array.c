/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of POST /volumes that makes a volume of an array in shared memory (UNIX.md).
 */
#include "http/routes_array.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "http/arrays.h"
#include "http/listener_private.h"
#include "protocol/array.h"
#include "render/array_memory.h"
#include "render/source.h"
#include "sp/shared_memory.h"

/* Members of a request that name another source, which excludes "memory". */
static const char *const others[] = { "source", "path",  "uri",    "upload",
                                      "volume", "field", "vectors" };

bool srv_array_is_for(const proto_json *body) {
    return proto_json_get(body, "memory") != NULL;
}

/* Returns the pointer of a member. */
static const char *pointer_to(const char *member, char text[32]) {
    snprintf(text, 32, "/%s", member);
    return text;
}

bool srv_array_check_absent(const proto_json *body, struct srv_reply *reply) {
    char pointer[32];
    for (int i = 0; proto_array_members[i]; i++)
        if (proto_json_get(body, proto_array_members[i])) {
            srv_reply_problem(reply, 422, pointer_to(proto_array_members[i], pointer),
                              "needs \"memory\"");
            return false;
        }
    return true;
}

static bool check_id(const proto_json *body, const char **id, struct srv_reply *reply) {
    const size_t digits = SRV_ARRAY_ID_BYTES - 1;
    *id = proto_json_string(proto_json_get(body, "memory"));
    if (*id && strlen(*id) == digits && strspn(*id, "0123456789abcdef") == digits)
        return true;
    srv_reply_problem(reply, 422, "/memory",
                      "must be the id of an array, which the daemon gave when it was passed");
    return false;
}

/* Opens the array and checks it against its description. */
static struct srv_array_memory *open_array(const struct srv_request *request, const char *id,
                                           const struct sp_volume_info *info,
                                           struct sp_error *err) {
    struct srv_arrays *arrays = request->http->arrays;
    uint64_t bytes;
    if (!arrays) {
        sp_fail(err, SP_ERR_DENIED, "/memory",
                "this daemon has no Unix socket; start it with --listen unix:PATH");
        return NULL;
    }
    int fd = srv_arrays_open(arrays, id, request->grant.name, &bytes, err);
    if (fd < 0)
        return NULL;
    struct srv_array_memory *memory = NULL;
    if (sp_volume_map_check(info, bytes, err) && !(memory = srv_array_memory_create(fd, info)))
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a volume");
    if (!memory)
        close(fd);
    return memory;
}

bool srv_array_read(const struct srv_request *request, const proto_json *body,
                    char source[SRV_ARRAY_SOURCE_BYTES], struct srv_volume_request *load,
                    struct srv_reply *reply) {
    struct sp_volume_info info;
    struct sp_error err;
    const char *id;
    char pointer[32];
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (proto_json_get(body, others[i])) {
            srv_reply_problem(reply, 422, pointer_to(others[i], pointer), "excludes \"memory\"");
            return false;
        }
    if (!check_id(body, &id, reply))
        return false;
    if (!proto_array_decode(body, &info, &err) ||
        !(load->memory = open_array(request, id, &info, &err))) {
        srv_reply_error(reply, &err);
        return false;
    }
    snprintf(source, SRV_ARRAY_SOURCE_BYTES, SRV_SOURCE_MEMORY "%s", id);
    load->source = source;
    load->pointer = "/memory";
    load->confined = false;
    return true;
}

void srv_array_opened(const struct srv_request *request, const char *source) {
    if (srv_source_is_memory(source))
        srv_arrays_remove(request->http->arrays, source + strlen(SRV_SOURCE_MEMORY));
}
