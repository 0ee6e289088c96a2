/* SPDX-License-Identifier: Apache-2.0 */
#include "http/ingress_quota.h"

#include <stdlib.h>
#include <string.h>

enum { HALF = SRV_INTAKE_ALL / 2 };

struct srv_intake_node { /* all, an owner, or a session */
    struct srv_intake_node *parent, *next, *first;
    int64_t children; /* nodes, or streams */
    char name[];
};

struct srv_intake {
    struct srv_intake_node *all;
    uint64_t tick;
    int64_t burst; /* of one stream */
    int64_t open;  /* of the half for who comes first, what is left; less than 0: owed */
};

static struct srv_intake_node *node_create(struct srv_intake_node *parent, const char *name) {
    const size_t size = strlen(name) + 1;
    struct srv_intake_node *node = calloc(1, sizeof *node + size);
    if (!node)
        return NULL;
    memcpy(node->name, name, size);
    node->parent = parent;
    if (parent) {
        node->next = parent->first;
        parent->first = node;
        parent->children++;
    }
    return node;
}

static struct srv_intake_node *find(struct srv_intake_node *parent, const char *name) {
    struct srv_intake_node *node = parent->first;
    while (node && strcmp(node->name, name) != 0)
        node = node->next;
    return node ? node : node_create(parent, name);
}

/* Ends nodes that have no children, from here upwards, but for the one of all. */
static void prune(struct srv_intake_node *node) {
    while (node->parent && node->children == 0) {
        struct srv_intake_node *parent = node->parent, **link = &parent->first;
        while (*link != node)
            link = &(*link)->next;
        *link = node->next;
        parent->children--;
        free(node);
        node = parent;
    }
}

struct srv_intake *srv_intake_create(size_t message_bytes) {
    struct srv_intake *intake = calloc(1, sizeof *intake);
    if (!intake)
        return NULL;
    intake->all = node_create(NULL, "");
    intake->open = HALF;
    intake->burst = message_bytes > SRV_INTAKE_STREAM ? (int64_t)message_bytes : SRV_INTAKE_STREAM;
    if (!intake->all)
        srv_intake_destroy(&intake);
    return intake;
}

void srv_intake_destroy(struct srv_intake **intake) {
    if (*intake)
        free((*intake)->all);
    free(*intake);
    *intake = NULL;
}

void srv_intake_tick(struct srv_intake *intake) {
    intake->tick++;
    intake->open = intake->open > 0 ? HALF : intake->open + HALF;
}

bool srv_intake_open(struct srv_intake *intake, const char *owner, const char *session,
                     struct srv_intake_stream *stream) {
    struct srv_intake_node *above = find(intake->all, owner);
    struct srv_intake_node *node = above ? find(above, session) : NULL;
    if (!node) {
        if (above)
            prune(above);
        return false;
    }
    node->children++;
    *stream = (struct srv_intake_stream){
        .intake = intake, .session = node, .tick = intake->tick, .left = intake->burst
    };
    return true;
}

void srv_intake_close(struct srv_intake_stream *stream) {
    if (!stream->intake)
        return;
    stream->session->children--;
    prune(stream->session);
    stream->intake = NULL;
}

/* As it is in this tick. */
static struct srv_intake_stream renewed(const struct srv_intake_stream *stream) {
    const struct srv_intake *intake = stream->intake;
    const uint64_t ticks = intake->tick - stream->tick;
    struct srv_intake_stream now = *stream;
    if (ticks == 0)
        return now;
    const int64_t missing = intake->burst - stream->left;
    now.left = ticks > (uint64_t)(missing / SRV_INTAKE_STREAM)
                   ? intake->burst
                   : stream->left + (int64_t)ticks * SRV_INTAKE_STREAM;
    now.sure = 0;
    now.tick = intake->tick;
    return now;
}

/* What is left of its own part of the half that is shared out. */
static int64_t sure_left(const struct srv_intake_stream *stream) {
    int64_t part = HALF;
    for (const struct srv_intake_node *node = stream->session; node; node = node->parent)
        part /= node->children;
    return part > stream->sure ? part - stream->sure : 0;
}

bool srv_intake_has(const struct srv_intake_stream *stream) {
    const struct srv_intake_stream now = renewed(stream);
    return now.left > 0 && (now.intake->open > 0 || sure_left(&now) > 0);
}

void srv_intake_take(struct srv_intake_stream *stream, size_t bytes) {
    *stream = renewed(stream);
    const int64_t size = (int64_t)bytes, sure = sure_left(stream);
    const int64_t own = size < sure ? size : sure;
    stream->left -= size;
    stream->sure += own;
    stream->intake->open -= size - own;
}
