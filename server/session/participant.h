/* SPDX-License-Identifier: Apache-2.0
 *
 * The participants of sessions: one per stream. A participant belongs to the thread that joined it,
 * and only that thread makes it leave. All functions are thread-safe.
 *
 *   text message ──► srv_hub_message ──► session ──► the scheduler asks for a frame
 *                                          │                    │
 *   socket ◄── srv_hub_next_message ◄── pending notifications, outbox ◄── encoded frame
 *
 * Everything is pulled. The stream thread asks for the next message when the socket can take it.
 * A notification is one bit per kind; its text is made when it is sent, from the state at that
 * moment. So no queue grows, and a slow client skips states instead of falling behind.
 */
#ifndef SRV_SESSION_PARTICIPANT_H
#define SRV_SESSION_PARTICIPANT_H

#include "session/hub.h"
#include "session/outbox.h"

struct srv_participant;

enum { SRV_PARTICIPANT_NAME_BYTES = 65 };

/* Joins a session. `token`: the name of the daemon's token that the client used, "" = a join token
 * of the session. srv_hub_pop_ready() returns `user`. NULL with SP_ERR_NOT_FOUND, SP_ERR_BUDGET
 * (too many participants) or SP_ERR_DENIED (the token changed meanwhile). */
struct srv_participant *srv_hub_join(struct srv_hub *hub, const char *id, enum srv_role role,
                                     const char *token, void *user, double now_ms,
                                     struct sp_error *err);
void srv_hub_leave(struct srv_hub *hub, struct srv_participant **participant, double now_ms);

/* Handles one text message. *answer is malloc'ed, NULL = no answer. False: memory ran out; close
 * the stream. */
bool srv_hub_message(struct srv_hub *hub, struct srv_participant *participant, const char *text,
                     size_t size, double now_ms, char **answer, size_t *answer_size);

/* Returns the user pointer of a participant that has something to send; NULL = none. A participant
 * is returned once, and again only after something new has to be sent to it. */
void *srv_hub_pop_ready(struct srv_hub *hub);

enum srv_message_kind { SRV_MESSAGE_NONE, SRV_MESSAGE_TEXT, SRV_MESSAGE_FRAME, SRV_MESSAGE_CLOSE };
struct srv_message {
    char *text; /* malloc'ed, owned by the caller */
    size_t size;
    struct srv_blob *blob; /* the caller's reference */
    struct proto_frame_header header;
    uint16_t close_code;
    const char *reason; /* a constant */
};
/* The messages that srv_hub_next_message() may return, in addition to answers, the notification of
 * the shutdown, and the end of the stream. Notifications can wait, because a later notification
 * reports a newer state. */
enum srv_next { SRV_NEXT_NOTIFICATIONS, SRV_NEXT_ALL, SRV_NEXT_FRAMES };
enum srv_message_kind srv_hub_next_message(struct srv_hub *hub, struct srv_participant *participant,
                                           enum srv_next allowed, double now_ms,
                                           struct srv_message *message);
/* Returns when the oldest unacknowledged frame was sent, ms; 0 = there is none. */
double srv_hub_oldest_unacked_ms(struct srv_hub *hub, struct srv_participant *participant);
/* The client answered the ping before a frame, or the one behind it (is_end): it has arrived. */
void srv_hub_arrived(struct srv_hub *hub, struct srv_participant *participant, uint32_t frame,
                     bool is_end, double now_ms);

/* The client answered a ping after rtt_ms. No frame was unacknowledged when it was sent. */
void srv_hub_ponged(struct srv_hub *hub, struct srv_participant *participant, double rtt_ms,
                    double now_ms);
uint64_t srv_participant_id(const struct srv_participant *participant);

#endif
