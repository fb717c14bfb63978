/* SPDX-License-Identifier: Apache-2.0 */
/* Why there is no connection to a broker, in words. */
#ifndef LP_MQTT_REASONS_H
#define LP_MQTT_REASONS_H

#include <stdbool.h>
#include <stddef.h>

struct lp_mqtt_failure {
	int code;    /* of libmosquitto */
	int number;  /* errno with MOSQ_ERR_ERRNO */
	int refusal; /* of MQTT 3.1.1; 0: the broker has not refused */
	bool was_connected;
	bool is_unasked; /* it has sent a message */
	bool has_login;
	bool is_tls;
	bool is_untrusted, is_other_name; /* its certificate */
};

/* The reason and the next step into `text`. Returns the stage. */
const char *lp_mqtt_reason(const struct lp_mqtt_failure *failure, char *text, size_t size_bytes);

#endif
