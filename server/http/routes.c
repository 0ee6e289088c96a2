/* SPDX-License-Identifier: Apache-2.0 */
#include "http/routes.h"

/* The query parameters of a route besides "token" (struct srv_route). */
/* clang-format off */
#define NONE { NULL }
#define PAGE { "after", "limit" }
#define IMAGE { "format", "quality", "subsampling" }
#define SAVED_IMAGE { "camera", "size", "format", "quality", "subsampling" }
#define SNAPSHOT { "background", "size", "format", "quality", "subsampling" }
#define AXES { "axis", "step" }
#define LIST { "format" }
#define SLICE {"axis","index","level","origin","normal","up","size","spacing","window","color",\
                       "format","step"}
#define SESSION_SLICE {"axis","index","level","origin","normal","up","size","spacing","window",\
                       "color","format","step","channel"}
#define FILES { "path", "after", "limit", "find" }
#define FOLDER { "path" }
/* clang-format on */

static const struct srv_route routes[] = {
    { SRV_GET, "/healthz", SRV_RIGHT_NONE, srv_get_healthz, NONE },
    { SRV_GET, "/metrics", SRV_RIGHT_METRICS, srv_get_metrics, NONE },
    { SRV_GET, "/readyz", SRV_RIGHT_NONE, srv_get_readyz, NONE },
    { SRV_GET, "/api/v1/openapi.json", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/openapi.yaml", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/view.schema.json", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/stream.md", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/stream.schema.json", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/volumes", SRV_RIGHT_VIEW, srv_get_volumes, NONE },
    { SRV_POST, "/api/v1/volumes", SRV_RIGHT_CONTROL, srv_post_volume, NONE },
    { SRV_GET, "/api/v1/volumes/{}", SRV_RIGHT_VIEW, srv_get_volume, NONE },
    { SRV_DELETE, "/api/v1/volumes/{}", SRV_RIGHT_CONTROL, srv_delete_volume, NONE },
    { SRV_GET, "/api/v1/volumes/{}/view", SRV_RIGHT_VIEW, srv_get_volume_view, NONE },
    { SRV_GET, "/api/v1/volumes/{}/histogram", SRV_RIGHT_VIEW, srv_get_histogram, AXES },
    { SRV_GET, "/api/v1/volumes/{}/slice", SRV_RIGHT_VIEW, srv_get_slice, SLICE },
    { SRV_OPTIONS, "/api/v1/uploads", SRV_RIGHT_CONTROL, srv_options_uploads, NONE },
    { SRV_GET, "/api/v1/uploads", SRV_RIGHT_CONTROL, srv_get_uploads, NONE },
    { SRV_POST, "/api/v1/uploads", SRV_RIGHT_CONTROL, srv_post_upload, NONE },
    { SRV_GET, "/api/v1/uploads/{}", SRV_RIGHT_CONTROL, srv_get_upload, NONE },
    { SRV_PATCH, "/api/v1/uploads/{}", SRV_RIGHT_CONTROL, srv_patch_upload, NONE },
    { SRV_DELETE, "/api/v1/uploads/{}", SRV_RIGHT_CONTROL, srv_delete_upload, NONE },
    { SRV_GET, "/api/v1/files", SRV_RIGHT_CONTROL, srv_get_files, FILES },
    { SRV_GET, "/api/v1/files/series", SRV_RIGHT_CONTROL, srv_get_series, FOLDER },
    { SRV_POST, "/api/v1/measure", SRV_RIGHT_VIEW, srv_post_measure, NONE },
    { SRV_POST, "/api/v1/render", SRV_RIGHT_RENDER, srv_post_render, IMAGE },
    { SRV_GET, "/api/v1/render/{}", SRV_RIGHT_RENDER, srv_get_render, SAVED_IMAGE },
    { SRV_GET, "/api/v1/views", SRV_RIGHT_RENDER, srv_get_views, PAGE },
    { SRV_POST, "/api/v1/views", SRV_RIGHT_RENDER, srv_post_view, NONE },
    { SRV_GET, "/api/v1/views/{}", SRV_RIGHT_VIEW, srv_get_view, NONE },
    { SRV_PATCH, "/api/v1/views/{}", SRV_RIGHT_RENDER, srv_patch_view, NONE },
    { SRV_DELETE, "/api/v1/views/{}", SRV_RIGHT_RENDER, srv_delete_view, NONE },
    { SRV_GET, "/api/v1/presets", SRV_RIGHT_VIEW, srv_get_presets, NONE },
    { SRV_GET, "/api/v1/presets/{}", SRV_RIGHT_VIEW, srv_get_preset, NONE },
    { SRV_PUT, "/api/v1/presets/{}", SRV_RIGHT_CONTROL, srv_put_preset, NONE },
    { SRV_DELETE, "/api/v1/presets/{}", SRV_RIGHT_CONTROL, srv_delete_preset, NONE },
    { SRV_GET, "/api/v1/paths", SRV_RIGHT_RENDER, srv_get_paths, PAGE },
    { SRV_POST, "/api/v1/paths", SRV_RIGHT_RENDER, srv_post_path, NONE },
    { SRV_GET, "/api/v1/paths/{}", SRV_RIGHT_RENDER, srv_get_path, NONE },
    { SRV_DELETE, "/api/v1/paths/{}", SRV_RIGHT_RENDER, srv_delete_path, NONE },
    { SRV_GET, "/api/v1/paths/{}/events", SRV_RIGHT_RENDER, srv_get_path_events, NONE },
    { SRV_GET, "/api/v1/paths/{}/frames/{}", SRV_RIGHT_RENDER, srv_get_path_frame, NONE },
    { SRV_GET, "/api/v1/paths/{}/archive", SRV_RIGHT_RENDER, srv_get_path_archive, NONE },
    { SRV_GET, "/api/v1/paths/{}/movie", SRV_RIGHT_RENDER, srv_get_path_movie, NONE },
    { SRV_GET, "/api/v1/sessions", SRV_RIGHT_CONTROL, srv_get_sessions, PAGE },
    { SRV_POST, "/api/v1/sessions", SRV_RIGHT_SESSION, srv_post_session, NONE },
    { SRV_GET, "/api/v1/sessions/{}", SRV_RIGHT_SESSION, srv_get_session, NONE },
    { SRV_PATCH, "/api/v1/sessions/{}", SRV_RIGHT_SESSION_CONTROL, srv_patch_session, NONE },
    { SRV_DELETE, "/api/v1/sessions/{}", SRV_RIGHT_SESSION_CONTROL, srv_delete_session, NONE },
    { SRV_GET, "/api/v1/sessions/{}/volumes", SRV_RIGHT_SESSION, srv_get_session_volumes, NONE },
    { SRV_GET, "/api/v1/sessions/{}/volumes/{}", SRV_RIGHT_SESSION, srv_get_session_volume, NONE },
    { SRV_GET, "/api/v1/sessions/{}/volumes/{}/view", SRV_RIGHT_SESSION,
      srv_get_session_volume_view, NONE },
    { SRV_GET, "/api/v1/sessions/{}/histogram", SRV_RIGHT_SESSION, srv_get_histogram, AXES },
    { SRV_GET, "/api/v1/sessions/{}/visible", SRV_RIGHT_SESSION, srv_get_session_visible, NONE },
    { SRV_GET, "/api/v1/sessions/{}/slice", SRV_RIGHT_SESSION, srv_get_slice, SESSION_SLICE },
    { SRV_POST, "/api/v1/sessions/{}/measure", SRV_RIGHT_SESSION, srv_post_session_measure, NONE },
    { SRV_GET, "/api/v1/sessions/{}/measures", SRV_RIGHT_SESSION, srv_get_session_measures, LIST },
    { SRV_POST, "/api/v1/sessions/{}/measures", SRV_RIGHT_SESSION_CONTROL,
      srv_post_session_measures, NONE },
    { SRV_PUT, "/api/v1/sessions/{}/measures/{}", SRV_RIGHT_SESSION_CONTROL,
      srv_put_session_measure, NONE },
    { SRV_PATCH, "/api/v1/sessions/{}/measures/{}", SRV_RIGHT_SESSION_CONTROL,
      srv_patch_session_measure, NONE },
    { SRV_DELETE, "/api/v1/sessions/{}/measures/{}", SRV_RIGHT_SESSION_CONTROL,
      srv_delete_session_measure, NONE },
    { SRV_GET, "/api/v1/sessions/{}/snapshot", SRV_RIGHT_SESSION, srv_get_session_snapshot,
      SNAPSHOT },
    { SRV_GET, "/api/v1/sessions/{}/stream", SRV_RIGHT_SESSION, srv_get_stream, NONE },
};
enum { ROUTES = sizeof routes / sizeof *routes };

const struct srv_route *srv_routes_find(const char *method, const char *path,
                                        char param[SRV_PARAM_BYTES], unsigned *allowed) {
    return srv_route_find(routes, ROUTES, method, path, param, allowed);
}
