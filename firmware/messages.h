/* SPDX-License-Identifier: Apache-2.0 */
/* What the messages of proto/mcu.dbc mean here. The only file that sees the generated packers is
 * messages.c. */
#ifndef MESSAGES_H
#define MESSAGES_H

struct firmware;
struct link_message;
struct ring_report;

/* Carries out a request and answers it. */
void messages_handle(struct firmware *firmware, const struct link_message *received);

/* Every millisecond: what is due by time. */
void messages_tick(struct firmware *firmware);

/* Sends what is owed, as far as the link has room. */
void messages_poll(struct firmware *firmware);

/* Sends a ring, or drops it when the link is behind. */
void messages_ring(struct firmware *firmware, const struct ring_report *report);

#endif
