/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The connection to a broker, in a thread of its own, because looking up a name and connecting may
 * block. It talks with the loop over a pair of sockets (drivers/link/bus_thread.h): the loop sends
 * one message at a time, each a struct lp_mqtt_message of its real length; the thread answers with
 * struct lp_mqtt_report. The thread connects again by itself.
 */
#ifndef LP_MQTT_SESSION_H
#define LP_MQTT_SESSION_H

#include <stdint.h>

#include "drivers/publisher/mqtt/options.h"
#include "include/packet.h"

struct lp_bus_thread;

/* Of the probe's topic, one below each. In the order in which they are sent to a new broker. */
enum lp_mqtt_topic { LP_MQTT_HELLO, LP_MQTT_ESTIMATE, LP_MQTT_HEALTH, LP_MQTT_TOPICS };

extern const char *const lp_mqtt_topics[LP_MQTT_TOPICS];

struct lp_mqtt_message {
	uint32_t connection; /* that it is for: of another one it is dropped */
	uint32_t topic;
	uint8_t data[LP_PACKET_MAX_BYTES]; /* none: the broker forgets what it has retained */
};

enum lp_mqtt_event {
	LP_MQTT_CONNECTED, /* a new connection takes messages */
	LP_MQTT_SENT,	   /* the message has left: the next one may come */
	LP_MQTT_AWAY,	   /* there is no connection; `text` says why, with the next step */
};

struct lp_mqtt_report {
	enum lp_mqtt_event event;
	uint32_t connection;
	const char *stage; /* of LP_MQTT_AWAY; static */
	char text[160];
};

/* 0 or -errno. Destroy the thread with lp_bus_thread_destroy(). */
int lp_mqtt_session_start(const struct lp_mqtt_options *options, struct lp_bus_thread **thread);

#endif
