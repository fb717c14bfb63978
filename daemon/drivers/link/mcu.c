/* SPDX-License-Identifier: Apache-2.0 */
/* Who uses the connection, how it is built up and down, and the users' commands. */
#include "drivers/link/mcu.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/macros.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/link/mcu_parts.h"

#define TICK_NS (20 * LP_NS_PER_MS)
#define FIRST_RETRY_NS (200 * LP_NS_PER_MS)
#define LAST_RETRY_NS (2 * LP_NS_PER_S)
#define FIRST_CLEAR_NS (2 * LP_NS_PER_S)
#define LAST_CLEAR_NS (60 * LP_NS_PER_S)

void lp_mcu_report_fault(struct lp_mcu *mcu, const char *id, const char *text)
{
	for (struct lp_mcu_user *user = mcu->users; user; user = user->next)
		user->fault(user, id, text);
}

/* ---------------------------------------------------------------- building up and down */

static const struct lp_link_ops *carrier_of(const struct lp_uri *uri, const char **device)
{
	static const struct lp_link_ops *const carriers[] = {&lp_link_serial_ops, &lp_link_i2c_ops,
							     &lp_link_can_ops};

	for (size_t i = 0; i < LP_COUNT(carriers); i++) {
		const size_t length = strlen(carriers[i]->scheme);

		if (strncmp(uri->rest, carriers[i]->scheme, length) == 0 &&
		    uri->rest[length] == ':' && uri->rest[length + 1]) {
			*device = uri->rest + length + 1;
			return carriers[i];
		}
	}
	lp_error(uri->text, "carrier",
		 "name one: mcu:serial:/dev/ttyUSB0, mcu:i2c:/dev/i2c-1 or mcu:can:can0");
	return NULL;
}

static const struct lp_param list[] = {
	{"baud", LP_PARAM_INT, offsetof(struct lp_mcu_settings, baud), .initial = "500000",
	 .min = 115200, .max = 1000000, .help = "baud rate of a serial line"},
	{"address", LP_PARAM_HEX, offsetof(struct lp_mcu_settings, address), .initial = "0x2c",
	 .min = 0x08, .max = 0x77, .help = "address on I2C"},
	{"ring_scans", LP_PARAM_INT, offsetof(struct lp_mcu_settings, ring_scans), .initial = "8",
	 .min = 8, .max = 255, .help = "scans of 1.25 ms per sample of the ring"},
};
const struct lp_params lp_mcu_params = LP_PARAMS(list);

static void destroy(struct lp_mcu *mcu)
{
	struct lp_connection **at = &mcu->connections->first;

	while (*at && *at != &mcu->base)
		at = &(*at)->next;
	if (*at)
		*at = mcu->base.next;
	if (mcu->link)
		mcu->link->ops->destroy(mcu->link);
	lp_timer_stop(&mcu->tick);
	free(mcu);
}

static int create_link(struct lp_mcu *mcu, struct lp_loop *loop, const struct lp_link_ops *carrier,
		       const char *device)
{
	const struct lp_link_host host = {.context = mcu,
					  .loop = loop,
					  .received = lp_mcu_received,
					  .lost = lp_mcu_lost,
					  .fault = lp_mcu_link_fault};
	const struct lp_link_settings settings = {.baud = mcu->settings.baud,
						  .address = mcu->settings.address};

	return carrier->create(device, &settings, &host, &mcu->link);
}

static int create(struct lp_connections *connections, struct lp_loop *loop,
		  const struct lp_uri *uri, const struct lp_mcu_settings *settings,
		  struct lp_mcu **result)
{
	const char *device;
	const struct lp_link_ops *carrier = carrier_of(uri, &device);
	struct lp_mcu *mcu = carrier ? calloc(1, sizeof(*mcu)) : NULL;
	int ret;

	if (!mcu)
		return carrier ? -ENOMEM : -EINVAL;
	mcu->connections = connections;
	mcu->settings = *settings;
	mcu->base.name = mcu->name;
	lp_timer_init(loop, &mcu->tick, lp_mcu_tick);
	mcu->retry = (struct lp_backoff){.first_ns = FIRST_RETRY_NS, .longest_ns = LAST_RETRY_NS};
	mcu->recovery.clear =
		(struct lp_backoff){.first_ns = FIRST_CLEAR_NS, .longest_ns = LAST_CLEAR_NS};
	(void)snprintf(mcu->name, sizeof(mcu->name), "%s", uri->rest);
	(void)snprintf(mcu->object, sizeof(mcu->object), "mcu:%s", mcu->name);
	ret = create_link(mcu, loop, carrier, device);
	if (ret < 0) {
		if (ret != -EINVAL)
			lp_error(uri->text, "create", "%s", lp_strerror(ret));
		destroy(mcu);
		return ret;
	}
	mcu->base.next = connections->first;
	connections->first = &mcu->base;
	*result = mcu;
	return 0;
}

/* The line is set up already, but what is told of the ring can still be changed. */
static int merge_settings(struct lp_mcu *mcu, const struct lp_uri *uri,
			  const struct lp_mcu_settings *settings)
{
	const struct lp_mcu_settings *present = &mcu->settings;

	if ((lp_uri_has(uri, "baud") && settings->baud != present->baud) ||
	    (lp_uri_has(uri, "address") && settings->address != present->address)) {
		lp_error(uri->text, "options",
			 "baud or address differs from the other URI of %s — give the same values "
			 "in both",
			 mcu->name);
		return -EINVAL;
	}
	if (lp_uri_has(uri, "ring_scans"))
		mcu->settings.ring_scans = settings->ring_scans;
	return 0;
}

int lp_mcu_join(struct lp_connections *connections, struct lp_loop *loop, const struct lp_uri *uri,
		const struct lp_mcu_settings *settings, struct lp_mcu_user *user,
		struct lp_mcu **mcu)
{
	struct lp_connection *known = connections->first;
	struct lp_mcu *it;
	struct lp_mcu_user **end;
	int ret;

	while (known && strcmp(known->name, uri->rest) != 0)
		known = known->next;
	it = (struct lp_mcu *)known;
	ret = it ? merge_settings(it, uri, settings)
		 : create(connections, loop, uri, settings, &it);
	if (ret < 0)
		return ret;
	for (end = &it->users; *end; end = &(*end)->next)
		;
	user->next = NULL;
	*end = user;
	*mcu = it;
	return 0;
}

void lp_mcu_leave(struct lp_mcu *mcu, struct lp_mcu_user *user)
{
	struct lp_mcu_user **at = &mcu->users;

	while (*at && *at != user)
		at = &(*at)->next;
	if (*at)
		*at = user->next;
	if (!mcu->users)
		destroy(mcu);
}

void lp_mcu_start(struct lp_mcu *mcu)
{
	if (!mcu->tick.is_set)
		lp_timer_set(&mcu->tick, 0, TICK_NS);
}

/* ---------------------------------------------------------------- commands */

void lp_mcu_home(struct lp_mcu *mcu, uint8_t token)
{
	const struct mcu_wheel_action_t action = {token, MCU_WHEEL_ACTION_ACTION_HOME_CHOICE};

	LP_MCU_SEND(mcu, wheel_action, WHEEL_ACTION, &action);
}

void lp_mcu_release(struct lp_mcu *mcu)
{
	const struct mcu_wheel_action_t action = {0, MCU_WHEEL_ACTION_ACTION_RELEASE_CHOICE};

	if (mcu->state == LP_MCU_READY)
		LP_MCU_SEND(mcu, wheel_action, WHEEL_ACTION, &action);
}

void lp_mcu_move(struct lp_mcu *mcu, uint8_t token, float target_deg)
{
	const struct mcu_wheel_move_t move = {.token = token,
					      .target_cdeg = (int16_t)lrintf(target_deg * 100.0F)};

	LP_MCU_SEND(mcu, wheel_move, WHEEL_MOVE, &move);
}

void lp_mcu_look(struct lp_mcu *mcu)
{
	if (mcu->state != LP_MCU_READY)
		return;
	lp_mcu_ask_wheel(mcu);
}
