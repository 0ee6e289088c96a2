/* SPDX-License-Identifier: Apache-2.0 */
#include "http/websocket.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <wslay/wslay.h>

#include "common/clock.h"
#include "http/address.h"
#include "sp/log.h"

enum {
    FRAME_PING_BYTES = 5, /* payload of the pings around a frame; others have less */
    REPLIES_MAX = 64,     /* messages waiting for the socket at which reading stops */
    FRAGMENTS_MAX = 1024, /* per message, because each costs memory */
    READ_BYTES = 8192,    /* per srv_ws_read() */
    PIECE_BYTES = 512,    /* per recv: wslay handles all frames of a piece before it reads again */
    MESSAGES_BUDGET = 64, /* messages per srv_ws_write() */
};
#define CLOSE_MS 2000.0     /* to send queued messages after the decision to close */
#define TRIP_MS 5000.0      /* at least, between measurements of the round trip */
#define TRIP_FIRST_MS 100.0 /* between the first one, while much else begins, and the second */

struct out_frame { /* being sent: a ping, WebSocket header, frame header, then the image */
    uint8_t head[2 + FRAME_PING_BYTES + 10 + PROTO_FRAME_HEADER_BYTES];
    size_t head_size, sent;
    struct srv_blob *blob; /* NULL = no frame is being sent */
    uint32_t number;
    double since_ms;
};

struct srv_ws {
    struct srv_ws_options options;
    char peer[SRV_ADDRESS_TEXT];
    wslay_event_context_ptr context;
    struct srv_participant *participant;
    struct srv_ingress_stream ingress;
    size_t read_left;   /* bytes that this srv_ws_read() may still read */
    unsigned fragments; /* of the message being received */
    struct out_frame frame;
    double now_ms, heard_ms, pinged_ms, progress_ms, close_ms;
    double trip_ms;        /* when the last measurement of the round trip began */
    uint8_t trip;          /* its number, the ping's payload */
    bool is_trip_measured; /* its pong arrived */
    bool has_sent_frame;   /* since the last measurement of the round trip */
    bool end_of_file, broken, closing;
    bool is_behind; /* the last srv_ws_write() reached its limit with messages left */
    bool is_mute;   /* notifications wait for the next tick: their quota is used up */
    bool is_ended;  /* its end is counted in the metrics */
};

static bool has_replies(const struct srv_ws *ws) {
    return wslay_event_get_queued_msg_count(ws->context) >= REPLIES_MAX;
}

static ssize_t on_recv(wslay_event_context_ptr context, uint8_t *bytes, size_t size, int flags,
                       void *user) {
    (void)flags;
    struct srv_ws *ws = user;
    ssize_t got = -1;
    if (ws->read_left == 0 || !srv_ingress_has(&ws->ingress, SRV_INGRESS_READ) || has_replies(ws)) {
        wslay_event_set_error(context, WSLAY_ERR_WOULDBLOCK);
        return -1;
    }
    if (size > PIECE_BYTES)
        size = PIECE_BYTES;
    if (size > ws->read_left)
        size = ws->read_left;
    do
        got = ws->options.transport.recv(ws->options.transport.user, bytes, size);
    while (got < 0 && errno == EINTR);
    if (got > 0) {
        ws->read_left -= (size_t)got;
        srv_ingress_charge(&ws->ingress, SRV_INGRESS_READ, (size_t)got);
        ws->now_ms = fmax(ws->now_ms, ws->options.transport.clock_ms(ws->options.transport.user));
        ws->heard_ms = ws->now_ms;
        srv_metrics_add(ws->options.metrics, SRV_COUNT_BYTES_IN, (uint64_t)got);
        return got;
    }
    bool again = got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK);
    if (!again)
        ws->end_of_file = true;
    wslay_event_set_error(context, again ? WSLAY_ERR_WOULDBLOCK : WSLAY_ERR_CALLBACK_FAILURE);
    return -1;
}

/* Returns the number of bytes that the transport took; 0 = it is full, negative = it failed. */
static ssize_t send_pieces(struct srv_ws *ws, const struct iovec *parts, size_t count,
                           bool is_more) {
    ssize_t sent;
    do
        sent = ws->options.transport.send(ws->options.transport.user, parts, count, is_more);
    while (sent < 0 && errno == EINTR);
    if (sent > 0) {
        ws->progress_ms = ws->now_ms;
        srv_metrics_add(ws->options.metrics, SRV_COUNT_BYTES_OUT, (uint64_t)sent);
        return sent;
    }
    return sent < 0 && (errno == EAGAIN || errno == EWOULDBLOCK) ? 0 : -1;
}

static ssize_t on_send(wslay_event_context_ptr context, const uint8_t *bytes, size_t size,
                       int flags, void *user) {
    const struct iovec part = { (void *)bytes, size };
    ssize_t sent = send_pieces(user, &part, 1, flags & WSLAY_MSG_MORE);
    if (sent > 0)
        return sent;
    wslay_event_set_error(context, sent == 0 ? WSLAY_ERR_WOULDBLOCK : WSLAY_ERR_CALLBACK_FAILURE);
    return -1;
}

/* Counts the end of a stream once, with the first reason. */
static void count_stream_end(struct srv_ws *ws, enum srv_counter reason) {
    if (!ws->is_ended)
        srv_metrics_add(ws->options.metrics, reason, 1);
    ws->is_ended = true;
}

static enum srv_counter reason_of(uint16_t code) {
    return code == WSLAY_CODE_NORMAL_CLOSURE || code == WSLAY_CODE_GOING_AWAY ? SRV_COUNT_END_CLOSED
           : code == WSLAY_CODE_POLICY_VIOLATION ? SRV_COUNT_END_STALLED
                                                 : SRV_COUNT_END_PROTOCOL;
}

void srv_ws_close(struct srv_ws *ws, uint16_t code, const char *reason, double now_ms) {
    if (ws->closing)
        return;
    ws->closing = true;
    ws->close_ms = now_ms;
    count_stream_end(ws, reason_of(code));
    sp_log_with(code == 1000 || code == 1001 ? SP_LOG_DEBUG : SP_LOG_WARN,
                SP_LOG_FIELDS({ "session", ws->options.session }, { "peer", ws->peer }),
                "stream of %s closed with %u: %s", ws->peer, code, reason);
    if (wslay_event_queue_close(ws->context, code, (const uint8_t *)reason, strlen(reason)) != 0)
        ws->broken = true;
    wslay_event_shutdown_read(ws->context);
}

static void on_frame_start(wslay_event_context_ptr context,
                           const struct wslay_event_on_frame_recv_start_arg *frame, void *user) {
    (void)context;
    struct srv_ws *ws = user;
    srv_ingress_charge(&ws->ingress, SRV_INGRESS_READ, SRV_INGRESS_FRAME_BYTES);
    if (frame->opcode == WSLAY_CONNECTION_CLOSE && frame->payload_length == 1)
        srv_ws_close(ws, WSLAY_CODE_PROTOCOL_ERROR, "a close frame with half a status code",
                     ws->now_ms);
    if (wslay_is_ctrl_frame(frame->opcode))
        return;
    ws->fragments = frame->opcode == WSLAY_CONTINUATION_FRAME ? ws->fragments + 1 : 1;
    if (ws->fragments > FRAGMENTS_MAX)
        srv_ws_close(ws, WSLAY_CODE_MESSAGE_TOO_BIG, "a message of more than 1024 fragments",
                     ws->now_ms);
}

static void ping(struct srv_ws *ws, const uint8_t *payload, size_t size) {
    const struct wslay_event_msg out = { .opcode = WSLAY_PING, .msg = payload, .msg_length = size };
    ws->pinged_ms = ws->now_ms;
    if (wslay_event_queue_msg(ws->context, &out) != 0)
        ws->broken = true;
}

/* The network is idle: a ping measures the round trip without any queue. */
static void measure_trip(struct srv_ws *ws) {
    ws->trip++;
    ws->trip_ms = ws->now_ms;
    ws->is_trip_measured = ws->has_sent_frame = false;
    ping(ws, &ws->trip, 1);
}

static double trip_due_ms(const struct srv_ws *ws) {
    return ws->trip_ms + (ws->trip == 1 ? TRIP_FIRST_MS : TRIP_MS);
}

/* The payload of the ping before a frame, or of the one behind it. */
static void write_frame_ping(uint32_t number, bool is_end, uint8_t payload[FRAME_PING_BYTES]) {
    for (int i = 0; i < 4; i++)
        payload[i] = (uint8_t)(number >> 8 * i);
    payload[4] = is_end;
}

static void on_frame_pong(struct srv_ws *ws, const uint8_t payload[FRAME_PING_BYTES]) {
    uint32_t number = 0;
    for (int i = 0; i < 4; i++)
        number |= (uint32_t)payload[i] << 8 * i;
    srv_hub_arrived(ws->options.hub, ws->participant, number, payload[4], ws->now_ms);
}

static void on_pong(struct srv_ws *ws, const struct wslay_event_on_msg_recv_arg *message) {
    if (message->msg_length == FRAME_PING_BYTES)
        on_frame_pong(ws, message->msg);
    if (ws->is_trip_measured || message->msg_length != 1 || message->msg[0] != ws->trip)
        return;
    ws->is_trip_measured = true;
    srv_hub_ponged(ws->options.hub, ws->participant, ws->now_ms - ws->trip_ms, ws->now_ms);
}

static void on_message(wslay_event_context_ptr context,
                       const struct wslay_event_on_msg_recv_arg *message, void *user) {
    struct srv_ws *ws = user;
    if (!ws->closing && message->opcode == WSLAY_PONG)
        on_pong(ws, message);
    if (ws->closing || wslay_is_ctrl_frame(message->opcode))
        return; /* wslay answers pings itself */
    if (message->opcode != WSLAY_TEXT_FRAME) {
        srv_ws_close(ws, WSLAY_CODE_UNSUPPORTED_DATA, "clients send text messages only",
                     ws->now_ms);
        return;
    }
    char *answer;
    size_t size;
    const char *text = message->msg_length ? (const char *)message->msg : "";
    if (!srv_hub_message(ws->options.hub, ws->participant, text, message->msg_length, ws->now_ms,
                         &answer, &size)) {
        srv_ws_close(ws, WSLAY_CODE_INTERNAL_SERVER_ERROR, "out of memory", ws->now_ms);
        return;
    }
    srv_ingress_charge(&ws->ingress, SRV_INGRESS_READ, SRV_INGRESS_ANSWER * size);
    struct wslay_event_msg out = { .opcode = WSLAY_TEXT_FRAME,
                                   .msg = (const uint8_t *)answer,
                                   .msg_length = size };
    if (answer && wslay_event_queue_msg(context, &out) != 0)
        ws->broken = true;
    free(answer);
}

struct srv_ws *srv_ws_create(const struct srv_ws_options *options, double now_ms,
                             struct sp_error *err) {
    static const struct wslay_event_callbacks callbacks = {
        .recv_callback = on_recv,
        .send_callback = on_send,
        .on_frame_recv_start_callback = on_frame_start,
        .on_msg_recv_callback = on_message,
    };
    struct srv_ws *ws = calloc(1, sizeof *ws);
    if (!ws || wslay_event_context_server_init(&ws->context, &callbacks, ws) != 0) {
        free(ws);
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a stream");
        return NULL;
    }
    ws->options = *options;
    strncpy(ws->peer, options->peer, sizeof ws->peer - 1);
    wslay_event_config_set_max_recv_msg_length(ws->context, options->message_bytes);
    ws->heard_ms = ws->pinged_ms = ws->progress_ms = ws->now_ms = now_ms;
    struct srv_owner owner;
    srv_hub_session_owner(options->hub, options->session, &owner);
    if (srv_ingress_open(options->ingress, owner.name, options->session, &ws->ingress))
        ws->participant = srv_hub_join(options->hub, options->session, options->role,
                                       options->token, options->user, now_ms, err);
    else
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a stream");
    if (!ws->participant) {
        srv_ws_destroy(&ws, now_ms);
        return NULL;
    }
    srv_metrics_add(options->metrics, SRV_COUNT_JOINED, 1);
    measure_trip(ws);
    return ws;
}

void srv_ws_destroy(struct srv_ws **ws_pointer, double now_ms) {
    struct srv_ws *ws = *ws_pointer;
    *ws_pointer = NULL;
    if (!ws)
        return;
    if (ws->participant)
        count_stream_end(ws, SRV_COUNT_END_LOST);
    srv_hub_leave(ws->options.hub, &ws->participant, now_ms);
    srv_ingress_close(&ws->ingress);
    wslay_event_context_free(ws->context);
    srv_blob_unref(&ws->frame.blob);
    free(ws);
}

static bool is_sending(const struct srv_ws *ws) {
    return ws->frame.blob || wslay_event_get_queued_msg_count(ws->context) > 0;
}

/* Starts a call. Bytes may have arrived after the caller took its time: time never goes back. The
 * stall time of the socket starts when there is something to send. */
static void begin_call(struct srv_ws *ws, double now_ms) {
    ws->now_ms = fmax(ws->now_ms, now_ms);
    if (!is_sending(ws))
        ws->progress_ms = ws->now_ms;
}

/* wslay queues a close without a status code after a frame that it cannot parse. If nothing else is
 * being sent, this sends a close with the code instead. */
static void refuse_frame(struct srv_ws *ws) {
    static const uint8_t close[] = { 0x88, 2, WSLAY_CODE_PROTOCOL_ERROR >> 8,
                                     WSLAY_CODE_PROTOCOL_ERROR & 255 };
    ws->closing = true;
    ws->close_ms = ws->now_ms;
    count_stream_end(ws, SRV_COUNT_END_PROTOCOL);
    sp_log_with(SP_LOG_WARN,
                SP_LOG_FIELDS({ "session", ws->options.session }, { "peer", ws->peer }),
                "stream of %s closed: a frame violates RFC 6455", ws->peer);
    if (ws->frame.blob || wslay_event_get_queued_msg_count(ws->context) > 1)
        return;
    wslay_event_shutdown_write(ws->context);
    const struct iovec part = { (void *)close, sizeof close };
    if (send_pieces(ws, &part, 1, false) != (ssize_t)sizeof close)
        ws->broken = true;
}

void srv_ws_read(struct srv_ws *ws, double now_ms) {
    begin_call(ws, now_ms);
    if (!srv_ws_wants_read(ws))
        return;
    ws->read_left = READ_BYTES;
    int failed = wslay_event_recv(ws->context);
    if (failed == WSLAY_ERR_CALLBACK_FAILURE && !ws->end_of_file && !ws->closing)
        refuse_frame(ws);
    else if (failed)
        ws->broken = true;
    /* wslay closes the stream itself after errors of the peer and after its close. */
    if (!ws->closing && !wslay_event_want_read(ws->context)) {
        ws->closing = true;
        ws->close_ms = ws->now_ms;
        count_stream_end(ws, wslay_event_get_close_received(ws->context) ? SRV_COUNT_END_CLOSED
                             : ws->end_of_file                           ? SRV_COUNT_END_LOST
                                                                         : SRV_COUNT_END_PROTOCOL);
        sp_log_with(SP_LOG_DEBUG,
                    SP_LOG_FIELDS({ "session", ws->options.session }, { "peer", ws->peer }),
                    "stream of %s ends with %u", ws->peer,
                    wslay_event_get_status_code_received(ws->context));
    }
}

/* Takes ownership of the message's blob. */
static void begin_frame(struct srv_ws *ws, struct srv_message *message) {
    struct out_frame *frame = &ws->frame;
    uint64_t size = PROTO_FRAME_HEADER_BYTES + (uint64_t)message->blob->size;
    unsigned length_bytes = size < 126 ? 0 : size <= UINT16_MAX ? 2 : 8;
    uint8_t *head = frame->head;
    *head++ = 0x80 | WSLAY_PING; /* RFC 6455, 5.2: a message of one frame */
    *head++ = FRAME_PING_BYTES;
    write_frame_ping(message->header.frame, false, head);
    head += FRAME_PING_BYTES;
    *head++ = 0x80 | WSLAY_BINARY_FRAME;
    *head++ = (uint8_t)(length_bytes == 0 ? size : length_bytes == 2 ? 126 : 127);
    for (unsigned i = 0; i < length_bytes; i++)
        *head++ = (uint8_t)(size >> 8 * (length_bytes - 1 - i));
    proto_frame_header_encode(&message->header, head);
    frame->head_size = (size_t)(head - frame->head) + PROTO_FRAME_HEADER_BYTES;
    frame->sent = 0;
    frame->blob = message->blob;
    frame->number = message->header.frame;
    frame->since_ms = srv_clock_ms();
    ws->has_sent_frame = true;
}

static void end_frame(struct srv_ws *ws) {
    srv_metrics_time(ws->options.metrics, SRV_TIME_SEND, srv_clock_ms() - ws->frame.since_ms);
    srv_blob_unref(&ws->frame.blob);
    if (ws->closing)
        return;
    uint8_t payload[FRAME_PING_BYTES];
    write_frame_ping(ws->frame.number, true, payload);
    ping(ws, payload, sizeof payload);
}

/* False if the transport fails. */
static bool send_frame(struct srv_ws *ws) {
    struct out_frame *frame = &ws->frame;
    while (frame->blob) {
        size_t in_head = frame->sent < frame->head_size ? frame->sent : frame->head_size;
        size_t in_blob = frame->sent - in_head;
        const struct iovec parts[2] = {
            { frame->head + in_head, frame->head_size - in_head },
            { frame->blob->bytes + in_blob, frame->blob->size - in_blob },
        };
        ssize_t sent = send_pieces(ws, parts, 2, false);
        if (sent <= 0)
            return sent == 0;
        frame->sent += (size_t)sent;
        if (frame->sent == frame->head_size + frame->blob->size)
            end_frame(ws);
    }
    return true;
}

/* Queues the next message of the session; false if there is none. */
static bool pull(struct srv_ws *ws) {
    struct srv_message message;
    struct wslay_event_msg out = { .opcode = WSLAY_TEXT_FRAME };
    bool ok = true;
    ws->is_mute = !srv_ingress_has(&ws->ingress, SRV_INGRESS_NOTIFY);
    switch (srv_hub_next_message(ws->options.hub, ws->participant,
                                 ws->is_mute ? SRV_NEXT_FRAMES : SRV_NEXT_ALL, ws->now_ms,
                                 &message)) {
    case SRV_MESSAGE_NONE:
        return false;
    case SRV_MESSAGE_TEXT:
        srv_ingress_charge(&ws->ingress, SRV_INGRESS_NOTIFY, message.size);
        out.msg = (const uint8_t *)message.text;
        out.msg_length = message.size;
        ok = wslay_event_queue_msg(ws->context, &out) == 0;
        free(message.text);
        break;
    case SRV_MESSAGE_FRAME:
        begin_frame(ws, &message);
        break;
    case SRV_MESSAGE_CLOSE:
        srv_ws_close(ws, message.close_code, message.reason, ws->now_ms);
        break;
    }
    if (!ok)
        srv_ws_close(ws, WSLAY_CODE_INTERNAL_SERVER_ERROR, "out of memory", ws->now_ms);
    return true;
}

void srv_ws_write(struct srv_ws *ws, double now_ms) {
    begin_call(ws, now_ms);
    ws->is_behind = false;
    for (int i = 0; i < MESSAGES_BUDGET && !ws->broken; i++) {
        if (!is_sending(ws) && !ws->closing && !pull(ws))
            return;
        if (!srv_ws_wants_write(ws))
            return;
        bool is_frame = ws->frame.blob;
        if (is_frame ? !send_frame(ws) : wslay_event_send(ws->context) != 0) {
            sp_log_with(SP_LOG_INFO,
                        SP_LOG_FIELDS({ "session", ws->options.session }, { "peer", ws->peer }),
                        "stream of %s lost: %s", ws->peer, strerror(errno));
            ws->broken = true;
        }
        if (is_frame ? ws->frame.blob != NULL : wslay_event_want_write(ws->context))
            return; /* the socket is full */
    }
    ws->is_behind = true;
}

void srv_ws_tick(struct srv_ws *ws, double now_ms) {
    begin_call(ws, now_ms);
    if (ws->closing) {
        if (now_ms - ws->close_ms > CLOSE_MS)
            ws->broken = true;
        return;
    }
    /* A client whose bytes are not read is not silent; the stall limit covers it. */
    if (!srv_ws_wants_read(ws))
        ws->heard_ms = now_ms;
    double oldest_ms = srv_hub_oldest_unacked_ms(ws->options.hub, ws->participant);
    if (is_sending(ws) && now_ms - ws->progress_ms > ws->options.stall_ms) {
        sp_log_with(SP_LOG_WARN,
                    SP_LOG_FIELDS({ "session", ws->options.session }, { "peer", ws->peer }),
                    "stream of %s dropped: it took no data for %.1f s (--stall-time)", ws->peer,
                    ws->options.stall_ms / 1000);
        count_stream_end(ws, SRV_COUNT_END_STALLED);
        ws->broken = true;
    } else if (oldest_ms > 0 && now_ms - oldest_ms > ws->options.stall_ms) {
        srv_ws_close(ws, WSLAY_CODE_POLICY_VIOLATION,
                     "slow reader: a frame was not acknowledged in time (--stall-time)", now_ms);
    } else if (now_ms - ws->heard_ms > 3 * ws->options.ping_ms) {
        sp_log_with(SP_LOG_WARN,
                    SP_LOG_FIELDS({ "session", ws->options.session }, { "peer", ws->peer }),
                    "stream of %s dropped: silent for %.1f s (3 times --ping-time)", ws->peer,
                    3 * ws->options.ping_ms / 1000);
        count_stream_end(ws, SRV_COUNT_END_SILENT);
        ws->broken = true;
    } else if (now_ms - fmax(ws->heard_ms, ws->pinged_ms) > ws->options.ping_ms) {
        ping(ws, NULL, 0);
    } else if (ws->has_sent_frame && now_ms >= trip_due_ms(ws) && oldest_ms == 0 &&
               !is_sending(ws)) {
        measure_trip(ws);
    }
}

double srv_ws_deadline_ms(const struct srv_ws *ws) {
    if (ws->closing)
        return ws->close_ms + CLOSE_MS;
    if (ws->is_behind || ws->is_mute || !srv_ws_wants_read(ws))
        return ws->now_ms;
    double oldest_ms = srv_hub_oldest_unacked_ms(ws->options.hub, ws->participant);
    double due_ms = fmin(fmax(ws->heard_ms, ws->pinged_ms) + ws->options.ping_ms,
                         ws->heard_ms + 3 * ws->options.ping_ms);
    if (ws->has_sent_frame && oldest_ms == 0 && !is_sending(ws))
        due_ms = fmin(due_ms, trip_due_ms(ws));
    if (is_sending(ws))
        due_ms = fmin(due_ms, ws->progress_ms + ws->options.stall_ms);
    if (oldest_ms > 0)
        due_ms = fmin(due_ms, oldest_ms + ws->options.stall_ms);
    return due_ms;
}

static bool can_listen(const struct srv_ws *ws) {
    return !ws->broken && !ws->end_of_file && wslay_event_want_read(ws->context) &&
           !has_replies(ws);
}

bool srv_ws_wants_read(const struct srv_ws *ws) {
    return can_listen(ws) && srv_ingress_has(&ws->ingress, SRV_INGRESS_READ);
}

bool srv_ws_is_paused(const struct srv_ws *ws) {
    return can_listen(ws) && !srv_ingress_has(&ws->ingress, SRV_INGRESS_READ);
}

bool srv_ws_wants_write(const struct srv_ws *ws) {
    return !ws->broken && (ws->frame.blob || wslay_event_want_write(ws->context));
}

bool srv_ws_is_over(const struct srv_ws *ws) {
    return srv_ws_is_lost(ws) || (ws->closing && !srv_ws_wants_write(ws));
}

bool srv_ws_is_lost(const struct srv_ws *ws) {
    return ws->broken || ws->end_of_file;
}
