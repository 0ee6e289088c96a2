/* SPDX-License-Identifier: Apache-2.0
 *
 * The table of routes, and their handlers.
 */
#ifndef SRV_HTTP_ROUTES_H
#define SRV_HTTP_ROUTES_H

#include "http/request.h"

/* Finds a route in the table, as srv_route_find() does. */
const struct srv_route *srv_routes_find(const char *method, const char *path,
                                        char param[SRV_PARAM_BYTES], unsigned *allowed);

/* Handlers, by file. */
srv_handler srv_get_volumes, srv_get_volume, srv_post_volume, srv_delete_volume,
    srv_get_volume_view; /* routes_volumes.c */
/* Encodes {"id", "name", "source", "state", "progress", …} and, once the volume is loaded, its
 * description; in_full: with its histogram, its memory and the whole reason of a failure. NULL when
 * out of memory. */
proto_json *srv_encode_volume(const struct srv_request *request,
                              const struct srv_volume_status *status, bool in_full);
/* Finds a volume, whose `volume` the caller unrefs. False: the reply says that there is none. */
bool srv_find_volume(struct srv_request *request, const char *id, struct srv_volume_status *status,
                     struct srv_reply *reply);
/* Answers with the default view of the volume `id`. */
void srv_reply_default_view(struct srv_request *request, const char *id, struct srv_reply *reply);
/* Adds the ids of the volumes to an error about an unknown volume, as many as fit, if the token may
 * list them. */
void srv_name_volumes(const struct srv_request *request, struct sp_error *err);
/* Returns a use of a time step of a volume, which the caller releases: the step of the session's
 * view, or ?step=, by default the step with which the volume was opened. NULL: the reply has the
 * error. If the step is not loaded yet, the function starts to load it and replies with an error.
 * `view`: the view of the session, NULL = none. */
struct srv_volume *srv_acquire_step(struct srv_request *request, const char *id,
                                    const proto_json *view, struct srv_reply *reply);
/* Answers about the volume `id`. `view`: of the session that shows it; NULL = none. */
typedef void srv_volume_reply(struct srv_request *request, const char *id, const proto_json *view,
                              struct srv_reply *reply);
/* Answers about the volume that the session of the path shows. */
void srv_reply_for_session(struct srv_request *request, srv_volume_reply *answer,
                           struct srv_reply *reply); /* routes_sessions.c */
/* Answers about the volume of the path, for a route without a session. */
void srv_reply_for_volume(struct srv_request *request, srv_volume_reply *answer,
                          struct srv_reply *reply);
srv_handler srv_options_uploads, srv_get_uploads, srv_post_upload, srv_get_upload,
    srv_delete_upload;               /* routes_uploads.c */
srv_handler srv_patch_upload;        /* upload_body.c */
srv_handler srv_get_files;           /* routes_files.c */
srv_handler srv_get_series;          /* routes_series.c */
srv_handler srv_get_histogram;       /* routes_histogram.c */
srv_handler srv_get_slice;           /* routes_slice.c */
srv_handler srv_get_session_visible; /* routes_visible.c */
srv_handler srv_get_session_volumes, srv_get_session_volume,
    srv_get_session_volume_view; /* routes_session_volumes.c */
srv_handler srv_post_measure, srv_post_session_measure, srv_get_session_measures,
    srv_post_session_measures, srv_put_session_measure, srv_patch_session_measure,
    srv_delete_session_measure;                                        /* routes_measure.c */
srv_handler srv_post_render, srv_get_render, srv_get_session_snapshot; /* routes_render.c */
srv_handler srv_get_views, srv_post_view, srv_get_view, srv_patch_view,
    srv_delete_view; /* routes_views.c */
srv_handler srv_get_sessions, srv_post_session, srv_get_session, srv_patch_session,
    srv_delete_session, srv_get_stream; /* routes_sessions.c */
/* Checks the token for a route that needs SRV_RIGHT_SESSION or
 * SRV_RIGHT_SESSION_CONTROL, before the body is read. False: the
 * reply is a problem document. */
bool srv_session_admits(struct srv_request *request, struct srv_reply *reply);
srv_handler srv_get_presets, srv_get_preset, srv_put_preset,
    srv_delete_preset; /* routes_presets.c */
srv_handler srv_get_paths, srv_post_path, srv_get_path, srv_delete_path, srv_get_path_events,
    srv_get_path_frame, srv_get_path_archive, srv_get_path_movie; /* routes_paths.c */
srv_handler srv_get_metrics;                                      /* routes_metrics.c */
srv_handler srv_get_healthz, srv_get_readyz, srv_get_contract;    /* routes_static.c */
/* Serves a file of the web page; false if there is none at this path. */
bool srv_get_asset(struct srv_request *request, struct srv_reply *reply);

#endif
