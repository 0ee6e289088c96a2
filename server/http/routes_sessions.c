/* SPDX-License-Identifier: Apache-2.0 */
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "http/cors.h"
#include "http/headers.h"
#include "http/paging.h"
#include "http/request_checks.h"
#include "http/routes.h"
#include "http/saved_views.h"
#include "sp/log.h"

enum { KEY_CHARACTERS = 24 };
enum { FORK_BYTES = 256 }; /* {"from": id}, with blanks */
static const char subprotocol[] = "splatd.v1";
static const char how_to_fork[] =
    "give a token of the daemon, or fork a session with its control token";
static const char *const members_of_post[] = { "view", "from", NULL }, *const members_of_patch[] = {
    "view", NULL
};

/* False if the body has other members, or a "view" that is not an object: the reply is a problem
 * document. */
static bool has_only(const proto_json *body, const char *const *known, struct srv_reply *reply) {
    const proto_json *view = proto_json_get(body, "view");
    struct sp_error err;
    if (!proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (view && proto_json_type(view) != PROTO_JSON_OBJECT)
        srv_reply_problem(reply, 422, "/view", "must be an object");
    else
        return true;
    return false;
}

/* Returns the first view of a new session. The view belongs to *owner or to the body. NULL: the
 * reply is a problem document. */
static const proto_json *first_view(struct srv_request *request, const proto_json *body,
                                    proto_json **owner, struct srv_reply *reply) {
    const proto_json *from = proto_json_get(body, "from"), *view = proto_json_get(body, "view");
    const char *id = proto_json_string(from);
    struct sp_error err;
    if (!from)
        return view ? view : body; /* an empty body: all defaults */
    if (!id || view) {
        srv_reply_problem(reply, 422, "/from",
                          id ? "give either view or from, not both"
                             : "must be the id of a session or saved view");
        return NULL;
    }
    if ((*owner = srv_saved_view_get(request->app->store, id, &err)))
        return *owner;
    if (err.code == SP_ERR_NOT_FOUND &&
        (*owner = srv_hub_session_get(request->app->hub, id, false, srv_clock_ms(), &err)))
        return proto_json_get(*owner, "view");
    if (err.code == SP_ERR_NOT_FOUND)
        srv_reply_problem(reply, 422, "/from", "there is no session and no saved view '%.64s'", id);
    else
        srv_reply_error(reply, &err);
    return NULL;
}

/* True if the request has a token of the daemon, or the control token of the session body["from"].
 * False: the reply is a problem document. */
static bool may_fork(struct srv_request *request, const proto_json *body, struct srv_reply *reply) {
    struct sp_error err;
    enum srv_role role;
    const char *from = proto_json_string(proto_json_get(body, "from"));
    if (request->grant.rights) /* srv_session_admits() has checked them */
        return true;
    if (!from ||
        !srv_hub_authorize(request->app->hub, from, srv_request_token(request), &role, &err))
        srv_request_refuse_token(request, how_to_fork);
    else if (role != SRV_ROLE_CONTROL)
        /* A fork can show any volume, which is more than this token permits. */
        srv_reply_problem(reply, 403, NULL,
                          "this token may only watch the session; fork it with its control token");
    else
        return true;
    return false;
}

/* Finds the owner of the new session: the token of the request, or else the owner of the session
 * that is forked. */
static void owner_of(const struct srv_request *request, const proto_json *body,
                     struct srv_owner *owner) {
    srv_request_owner(request, owner);
    if (!request->grant.rights)
        srv_hub_session_owner(request->app->hub, proto_json_string(proto_json_get(body, "from")),
                              owner);
}

/* Creates the session. Deletes it again if the reply cannot be made. */
static void create_session(struct srv_request *request, const proto_json *body,
                           const proto_json *view, struct srv_reply *reply) {
    struct sp_error err;
    struct srv_owner owner;
    char id[SRV_SESSION_ID_BYTES];
    owner_of(request, body, &owner);
    proto_json *json = srv_hub_session_create(request->app->hub, view, &owner,
                                              !request->grant.rights, srv_clock_ms(), id, &err);
    if (!json) {
        srv_name_volumes(request, &err);
        srv_reply_view_error(reply, "/view", &err);
        return;
    }
    const char *from = proto_json_string(proto_json_get(body, "from"));
    if (from && !srv_hub_measures_fork(request->app->hub, from, id, srv_clock_ms(), &err))
        proto_json_free(&json); /* no memory: 503 below */
    srv_reply_json(reply, 201, json);
    if (reply->status != 201) {
        srv_hub_session_delete(request->app->hub, id, &err);
        return;
    }
    srv_reply_header(reply, "Location", "sessions/%s", id);
    sp_log_with(
        SP_LOG_INFO,
        SP_LOG_FIELDS({ "session", id }, { "peer", srv_connection_peer(request->connection) }),
        "session %s created for %s", id, srv_connection_peer(request->connection));
    srv_request_reply_when_durable(request);
}

void srv_post_session(struct srv_request *request, struct srv_reply *reply) {
    if (request->body_max && request->body_seen > request->body_max) {
        srv_request_refuse_token(request, how_to_fork);
        return;
    }
    proto_json *owner = NULL, *body = srv_request_json(request, reply);
    /* Check the rights first: a client without rights learns nothing about its body. */
    bool is_short = !body && reply->status == 503;
    bool ok = !is_short && may_fork(request, body, reply) && body &&
              has_only(body, members_of_post, reply);
    const proto_json *view = ok ? first_view(request, body, &owner, reply) : NULL;
    if (view)
        create_session(request, body, view, reply);
    proto_json_free(&owner);
    proto_json_free(&body);
}

static proto_json *encode_item(void *user, const void *item) {
    const struct srv_session_info *info = item;
    (void)user;
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "id", info->id);
    proto_json_set_string(&json, "volume", info->volume);
    if (info->owner[0])
        proto_json_set_string(&json, "owner", info->owner);
    proto_json_set_integer(&json, "participants", info->participants);
    proto_json_set_bool(&json, "hibernated", info->is_hibernated);
    proto_json_set_number(&json, "idle", info->idle_ms / 1000);
    return json;
}

void srv_get_sessions(struct srv_request *request, struct srv_reply *reply) {
    struct srv_page page;
    if (!srv_paging_begin(request, sizeof(struct srv_session_info), &page, reply))
        return;
    bool sees_all = request->grant.rights & SRV_RIGHT_ADMIN;
    srv_hub_list(request->app->hub, sees_all ? NULL : request->grant.name, srv_clock_ms(), &page);
    srv_paging_reply(&page, "sessions", encode_item, NULL, reply);
}

/* Copies the id of the session, which is the first parameter of the path. */
static void session_of(const struct srv_request *request, char id[SRV_PARAM_BYTES]) {
    snprintf(id, SRV_PARAM_BYTES, "%.*s", (int)strcspn(request->param, "/"), request->param);
}

/* Finds the role that the daemon's token of this request has in the session. False: none. */
static bool role_of_grant(const struct srv_request *request, enum srv_role *role) {
    struct srv_owner owner;
    char id[SRV_PARAM_BYTES];
    session_of(request, id);
    srv_hub_session_owner(request->app->hub, id, &owner);
    return srv_owner_role(&owner, request->grant.name, request->grant.rights, role);
}

/* Finds the role of the token in the session. A join token has the role that it was created for. A
 * token of the daemon controls the sessions that it created and watches others. False: no role, and
 * the reply is a problem document. */
static bool find_role(struct srv_request *request, enum srv_role *role, struct srv_reply *reply) {
    struct sp_error err;
    const char *token = srv_request_token(request);
    char id[SRV_PARAM_BYTES];
    session_of(request, id);
    if (srv_hub_authorize(request->app->hub, id, token, role, &err))
        return true;
    if (!request->grant.rights) /* without a valid token, do not reveal which sessions exist */
        srv_request_refuse_token(request,
                                 "give a token of the daemon, or one of an existing session");
    else if (!role_of_grant(request, role))
        srv_reply_problem(reply, 403, NULL, "the role of this token does not include this");
    else if (err.code != SP_ERR_DENIED && err.code != SP_ERR_IO) /* a damaged one can be deleted */
        srv_reply_error(reply, &err);
    else
        return true;
    return false;
}

static bool may(struct srv_request *request, enum srv_role wanted, struct srv_reply *reply) {
    enum srv_role role;
    if (!find_role(request, &role, reply))
        return false;
    if (role < wanted)
        srv_reply_problem(
            reply, 403, NULL, "%s",
            request->grant.rights & SRV_RIGHT_CONTROL
                ? "another token created this session; give its control token"
                : "this token may only watch the session; change it with its control token");
    return role >= wanted;
}

bool srv_session_admits(struct srv_request *request, struct srv_reply *reply) {
    unsigned rights = request->grant.rights;
    if (request->param[0]) { /* of one session */
        const bool is_change = request->route->needs == SRV_RIGHT_SESSION_CONTROL;
        return may(request, is_change ? SRV_ROLE_CONTROL : SRV_ROLE_VIEW, reply);
    }
    if (rights & SRV_RIGHT_CONTROL)
        return true;
    if (rights) {
        srv_reply_problem(reply, 403, NULL,
                          "a token needs the role control or admin to create a session");
    } else if (!srv_request_token(request)) {
        srv_request_refuse_token(request, how_to_fork);
    } else { /* the body may name a session to fork; a longer one is not stored */
        request->body_max = FORK_BYTES;
        return true;
    }
    return false;
}

void srv_get_session(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    enum srv_role role;
    bool is_owner = role_of_grant(request, &role) && role == SRV_ROLE_CONTROL;
    proto_json *json =
        srv_hub_session_get(request->app->hub, request->param, is_owner, srv_clock_ms(), &err);
    srv_reply_result(reply, json, &err);
}

void srv_patch_session(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    proto_json *body = srv_request_json(request, reply);
    if (body && has_only(body, members_of_patch, reply)) {
        const proto_json *view = proto_json_get(body, "view");
        proto_json *changed = srv_hub_session_patch(request->app->hub, request->param,
                                                    view ? view : body, srv_clock_ms(), &err);
        proto_json *json = changed ? proto_json_object() : NULL;
        proto_json_set_string(&json, "id", request->param);
        proto_json_set(&json, "view", changed);
        if (!changed) {
            srv_name_volumes(request, &err);
            srv_reply_view_error(reply, "/view", &err);
        } else {
            srv_reply_json(reply, 200, json);
        }
    }
    proto_json_free(&body);
    if (reply->status == 200)
        srv_request_reply_when_durable(request);
}

void srv_reply_for_session(struct srv_request *request, srv_volume_reply *answer,
                           struct srv_reply *reply) {
    struct sp_error err;
    char name[SRV_PARAM_BYTES];
    session_of(request, name);
    proto_json *session = srv_hub_session_get(request->app->hub, name, false, srv_clock_ms(), &err);
    const proto_json *view = proto_json_get(session, "view");
    const char *id = proto_json_string(proto_json_get(view, "volume"));
    if (!session)
        srv_reply_error(reply, &err);
    else if (!id)
        srv_reply_problem(reply, 409, NULL, "the session has no volume");
    else
        answer(request, id, view, reply);
    proto_json_free(&session);
}

void srv_reply_for_volume(struct srv_request *request, srv_volume_reply *answer,
                          struct srv_reply *reply) {
    if (request->route->needs == SRV_RIGHT_SESSION)
        srv_reply_for_session(request, answer, reply);
    else
        answer(request, request->param, NULL, reply);
}

void srv_delete_session(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    enum srv_role role;
    bool is_owner = role_of_grant(request, &role) && role == SRV_ROLE_CONTROL;
    if (!is_owner && !srv_hub_session_is_guests(request->app->hub, request->param)) {
        srv_reply_problem(reply, 403, NULL,
                          "only the token that created the session deletes it; a control token "
                          "deletes a fork that was made with a join token");
        return;
    }
    const bool ok = srv_hub_session_delete(request->app->hub, request->param, &err);
    srv_request_reply_changed(request, ok, &err);
}

/* Streams. */

struct upgrade { /* lives as long as the request, whether or not the upgrade succeeds */
    struct srv_streams *streams;
    struct srv_stream_start start;
};

static void close_upgraded(void *handle) {
    MHD_upgrade_action(handle, MHD_UPGRADE_ACTION_CLOSE);
}

static void on_upgrade(void *user, struct MHD_Connection *connection, void *state,
                       const char *extra, size_t extra_size, MHD_socket socket,
                       struct MHD_UpgradeResponseHandle *handle) {
    (void)connection;
    struct srv_request *request = state;
    struct upgrade *upgrade = user;
    upgrade->start.socket = socket;
    upgrade->start.extra = extra;
    upgrade->start.extra_size = extra_size;
    upgrade->start.owner = handle;
    upgrade->start.close = close_upgraded;
    srv_request_upgraded(request);
    if (!srv_streams_add(upgrade->streams, &upgrade->start)) {
        sp_log(SP_LOG_ERROR, "out of memory for the stream of %s",
               srv_connection_peer(request->connection));
        close_upgraded(handle);
    }
}

static bool check_handshake(struct srv_request *request, struct srv_reply *reply) {
    const char *key = srv_request_header(request, "Sec-WebSocket-Key");
    const char *version = srv_request_header(request, "Sec-WebSocket-Version");
    const char *offered = srv_request_header(request, "Sec-WebSocket-Protocol");
    const char *origin = srv_request_header(request, "Origin");
    if (!srv_header_has_token(srv_request_header(request, "Upgrade"), "websocket") ||
        !srv_header_has_token(srv_request_header(request, "Connection"), "upgrade")) {
        srv_reply_problem(reply, 426, NULL, "this path is a WebSocket; send an upgrade request");
        srv_reply_header(reply, "Upgrade", "websocket");
    } else if (!version || strcmp(version, "13") != 0) {
        srv_reply_problem(reply, 426, NULL, "Sec-WebSocket-Version must be 13");
        srv_reply_header(reply, "Sec-WebSocket-Version", "13");
    } else if (!key || strlen(key) != KEY_CHARACTERS) {
        srv_reply_problem(reply, 400, NULL, "Sec-WebSocket-Key must have %d characters",
                          KEY_CHARACTERS);
    } else if (offered && !srv_header_has_token(offered, subprotocol)) {
        srv_reply_problem(reply, 400, NULL, "the subprotocol must be %s", subprotocol);
    } else if (!srv_cors_is_same_origin(origin, srv_request_header(request, "Host")) &&
               !srv_cors_allows(request->app->config->allow_origin, origin)) {
        sp_log(SP_LOG_WARN, "stream of %s refused: Origin %.200s is not this host",
               srv_connection_peer(request->connection), origin);
        srv_reply_problem(reply, 403, NULL, "a page of another origin may not open a stream");
    } else {
        return true;
    }
    return false;
}

void srv_get_stream(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    enum srv_role role;
    if (!check_handshake(request, reply) || !find_role(request, &role, reply))
        return;
    if (!srv_hub_can_join(request->app->hub, request->param, request->grant.name, srv_clock_ms(),
                          &err)) {
        srv_reply_error(reply, &err);
        return;
    }
    char accept[SRV_WEBSOCKET_ACCEPT_BYTES];
    if (!srv_header_websocket_accept(srv_request_header(request, "Sec-WebSocket-Key"), accept)) {
        srv_reply_problem(reply, 503, NULL, "out of memory for a handshake");
        return;
    }
    struct upgrade *upgrade = calloc(1, sizeof *upgrade);
    struct MHD_Response *response =
        upgrade ? MHD_create_response_for_upgrade(on_upgrade, upgrade) : NULL;
    request->upgrade = upgrade;
    if (!response) {
        srv_reply_problem(reply, 503, NULL, "out of memory for a stream");
        return;
    }
    upgrade->streams = request->app->streams;
    upgrade->start.role = role;
    snprintf(upgrade->start.token, sizeof upgrade->start.token, "%s", request->grant.name);
    upgrade->start.peer = *srv_connection_address(request->connection);
    snprintf(upgrade->start.session, sizeof upgrade->start.session, "%.16s", request->param);
    MHD_add_response_header(response, "Upgrade", "websocket");
    MHD_add_response_header(response, "Sec-WebSocket-Accept", accept);
    if (srv_request_header(request, "Sec-WebSocket-Protocol"))
        MHD_add_response_header(response, "Sec-WebSocket-Protocol", subprotocol);
    if (MHD_queue_response(request->mhd, MHD_HTTP_SWITCHING_PROTOCOLS, response) == MHD_YES) {
        request->is_answered = true;
    } else {
        srv_reply_problem(reply, 500, NULL, "the connection cannot be upgraded");
    }
    MHD_destroy_response(response);
}
