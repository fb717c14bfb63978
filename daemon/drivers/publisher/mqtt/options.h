/* SPDX-License-Identifier: Apache-2.0 */
/* What the URIs of mqtt: and mqtts: say, and the file with user name and password. */
#ifndef LP_MQTT_OPTIONS_H
#define LP_MQTT_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>

#include "drivers/publisher/listen.h"
#include "include/wish.h"

struct lp_params;
struct lp_uri;

#define LP_MQTT_TOPIC_BYTES 200

struct lp_mqtt_options {
	struct lp_wish wish;
	int kind; /* of the wish: 0 ambient, 1 total */
	char login[1024], ca[1024];
	struct lp_tcp_address broker;
	char topic[LP_MQTT_TOPIC_BYTES];
	bool is_tls;
};

extern const struct lp_params lp_mqtt_params, lp_mqtts_params;

/* HOST[:PORT]/TOPIC and the keys, after options->is_tls has been set. Files that are named are
 * looked at. 0 or -errno, logged. */
int lp_mqtt_options_read(struct lp_mqtt_options *options, const struct lp_uri *uri);

/* Whether this broker may be called without TLS. 0: it is on this machine. 1: `insecure_lan`, with
 * a warning. -EACCES, logged. */
int lp_mqtt_check_open(const struct lp_tcp_address *broker, const char *object, bool insecure_lan);

struct lp_mqtt_login {
	char user[128], password[256];
};

/* The file's first line is the user name, its second one the password. 0; or -errno, and why, with
 * the next step, in `why`. Any thread. */
int lp_mqtt_login_read(const char *path, struct lp_mqtt_login *login, char *why, size_t size_bytes);

#endif
