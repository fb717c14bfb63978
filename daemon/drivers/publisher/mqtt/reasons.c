/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/mqtt/reasons.h"

#include <mosquitto.h>
#include <stdio.h>

#include "base/log.h"

/* The codes of MQTT 3.1.1, 3.2.2.3. */
static const char *refused(const struct lp_mqtt_failure *failure)
{
	switch (failure->refusal) {
	case 1:
		return "refused: the broker does not speak MQTT 3.1.1 — update it";
	case 2:
		return "refused: the broker does not take this client's id — see its log";
	case 3:
		return "refused: the broker is not available now — see its log";
	case 4:
	case 5:
		return failure->has_login ? "refused: user name or password is wrong, or may not "
					    "connect — correct the file of login="
					  : "refused: the broker wants a user name and a password "
					    "— name their file with login=";
	default:
		return "refused — see the log of the broker";
	}
}

static const char *lost(const struct lp_mqtt_failure *failure)
{
	if (failure->was_connected)
		return "the broker has closed the connection — see its log";
	return failure->is_tls ? "closed before any answer — is TLS on at this port of the broker?"
			       : "closed before any answer — does this port speak MQTT? with TLS "
				 "it is mqtts:";
}

static const char *tls_reason(const struct lp_mqtt_failure *failure)
{
	if (failure->is_other_name)
		return "the broker's certificate is for another name — call the broker by the "
		       "name in it";
	if (failure->is_untrusted)
		return "the broker's certificate is not trusted — name its authority's "
		       "certificate with ca=";
	return "no TLS there — is it mqtt: instead of mqtts:? else see the log of the broker";
}

const char *lp_mqtt_reason(const struct lp_mqtt_failure *failure, char *text, size_t size_bytes)
{
	const char *stage = failure->was_connected ? "connection" : "connect";
	const char *words = mosquitto_strerror(failure->code);

	if (failure->is_unasked) {
		(void)snprintf(text, size_bytes,
			       "the broker sends what nobody has subscribed to — see its log");
		return stage;
	}
	switch (failure->code) {
	case MOSQ_ERR_CONN_REFUSED:
		words = refused(failure);
		break;
	case MOSQ_ERR_CONN_LOST:
		words = lost(failure);
		break;
	case MOSQ_ERR_TLS:
		stage = "certificate";
		words = tls_reason(failure);
		break;
	case MOSQ_ERR_EAI:
		words = "the name is not known — is the broker's name right, is the network up?";
		break;
	case MOSQ_ERR_KEEPALIVE:
		words = "no answer from the broker for a while — is the network up?";
		break;
	case MOSQ_ERR_ERRNO:
		(void)snprintf(text, size_bytes,
			       "%s — does the broker run there, is the port right?",
			       lp_strerror(failure->number));
		return stage;
	default:
		break;
	}
	(void)snprintf(text, size_bytes, "%s", words);
	return stage;
}
