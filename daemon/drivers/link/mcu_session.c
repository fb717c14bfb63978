/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The conversation with the microcontroller: opened, greeted, told its rates, served; begun anew
 * when it was reset, unplugged or silent.
 */
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "drivers/link/mcu_faults.h"
#include "drivers/link/mcu_parts.h"

#define PROTOCOL_MAJOR 1
#define PROTOCOL_MINOR 3
#define MINOR_WITH_WHEEL_REQUEST 1

#define ASK_NS (200 * LP_NS_PER_MS)   /* greeting and rates are repeated */
#define GREETING_NS (5 * LP_NS_PER_S) /* a boot loader takes two seconds of it */
#define SILENCE_NS (2 * LP_NS_PER_S)
#define REFUSED_NS (10 * LP_NS_PER_S)	   /* until a wrong version is looked at again */
#define HELLO_ECHO_NS (500 * LP_NS_PER_MS) /* a Hello is the answer to ours for so long */
#define TIME_FAST_NS (100 * LP_NS_PER_MS)
#define TIME_SLOW_NS (1 * LP_NS_PER_S)
#define FAST_EXCHANGES 16
#define WHEEL_MS 100
#define COUNTERS_MS 1000

/* ---------------------------------------------------------------- what is asked */

static void ask_hello(struct lp_mcu *mcu, int64_t now_ns)
{
	const struct mcu_hello_request_t request = {PROTOCOL_MAJOR, PROTOCOL_MINOR};

	mcu->t_hello_ns = now_ns;
	LP_MCU_SEND(mcu, hello_request, HELLO_REQUEST, &request);
}

static bool anyone_wants_rings(const struct lp_mcu *mcu)
{
	for (const struct lp_mcu_user *user = mcu->users; user; user = user->next) {
		if (user->ring)
			return true;
	}
	return false;
}

static void ask_rates(struct lp_mcu *mcu)
{
	const struct mcu_rates_t rates = {.ring_scans = anyone_wants_rings(mcu)
								? (uint8_t)mcu->settings.ring_scans
								: 0,
					  .wheel_ms = WHEEL_MS,
					  .counters_ms = COUNTERS_MS};

	LP_MCU_SEND(mcu, rates, RATES, &rates);
}

void lp_mcu_ask_time(struct lp_mcu *mcu)
{
	const struct mcu_time_request_t request = {++mcu->time_count};

	mcu->t_time_ns = lp_clock_ns();
	mcu->time_sent_ns[mcu->time_count] = mcu->t_time_ns;
	LP_MCU_SEND(mcu, time_request, TIME_REQUEST, &request);
}

void lp_mcu_ask_status(struct lp_mcu *mcu)
{
	const struct mcu_status_request_t request = {0};

	LP_MCU_SEND(mcu, status_request, STATUS_REQUEST, &request);
}

/* One small message, and one in return; older firmware tells it among everything else. */
void lp_mcu_ask_wheel(struct lp_mcu *mcu)
{
	const struct mcu_wheel_request_t request = {++mcu->time_count};

	if (mcu->protocol_minor < MINOR_WITH_WHEEL_REQUEST) {
		mcu->time_count--;
		lp_mcu_ask_time(mcu);
		lp_mcu_ask_status(mcu);
		return;
	}
	mcu->time_sent_ns[mcu->time_count] = lp_clock_ns();
	LP_MCU_SEND(mcu, wheel_request, WHEEL_REQUEST, &request);
}

/* ---------------------------------------------------------------- states */

/* A fault of the connection, logged; NULL: over. */
static void connection_fault(struct lp_mcu *mcu, const char *id, const char *stage,
			     const char *reason)
{
	char text[640];

	if (reason) {
		(void)snprintf(text, sizeof(text), "%s: %s: %s", mcu->object, stage, reason);
		lp_warning(mcu->object, stage, "%s", reason);
	}
	lp_mcu_report_fault(mcu, id, reason ? text : NULL);
}

/* Nothing is known of the microcontroller any more. */
static void forget(struct lp_mcu *mcu)
{
	if (mcu->state == LP_MCU_READY) {
		for (struct lp_mcu_user *user = mcu->users; user; user = user->next) {
			if (user->lost)
				user->lost(user);
		}
	}
	lp_mcu_forget_wheel_faults(mcu);
	memset(&mcu->clock, 0, sizeof(mcu->clock));
	memset(mcu->time_sent_ns, 0, sizeof(mcu->time_sent_ns));
	mcu->wheel_waits = mcu->phase_known = mcu->ring_known = false;
	mcu->t_seen_ns = 0;
}

static void enter(struct lp_mcu *mcu, enum lp_mcu_state state)
{
	static const char *const names[] = {[LP_MCU_CLOSED] = "closed",
					    [LP_MCU_GREETING] = "greeting",
					    [LP_MCU_SETTING] = "setting rates",
					    [LP_MCU_READY] = "ready"};

	if (state != mcu->state)
		lp_debug(mcu->object, "session", "%s, was %s", names[state], names[mcu->state]);
	mcu->state = state;
	mcu->t_state_ns = lp_clock_ns();
	mcu->t_next_ns = mcu->t_state_ns;
}

static void close_link(struct lp_mcu *mcu, int64_t retry_ns)
{
	mcu->link->ops->close(mcu->link);
	forget(mcu);
	enter(mcu, LP_MCU_CLOSED);
	mcu->t_next_ns += retry_ns;
}

static void found(struct lp_mcu *mcu)
{
	enter(mcu, LP_MCU_READY);
	lp_backoff_reset(&mcu->retry);
	mcu->reconnects += mcu->was_found;
	mcu->was_found = true;
	for (struct lp_mcu_user *user = mcu->users; user; user = user->next) {
		if (user->found)
			user->found(user);
	}
	lp_mcu_ask_time(mcu);
	lp_mcu_ask_status(mcu);
}

/* ---------------------------------------------------------------- what it says */

/* The answer to a greeting that was sent twice. */
static bool is_echo(const struct lp_mcu *mcu, const struct mcu_hello_t *hello)
{
	return mcu->state != LP_MCU_GREETING && hello->boot_count == mcu->boot_count &&
	       mcu->t_heard_ns - mcu->t_hello_ns < HELLO_ECHO_NS;
}

/* Both versions, and which side is to be updated. */
static void version_fault(struct lp_mcu *mcu, const struct mcu_hello_t *hello, const char *id)
{
	const bool older = hello->protocol_major != PROTOCOL_MAJOR
				   ? hello->protocol_major < PROTOCOL_MAJOR
				   : hello->protocol_minor < PROTOCOL_MINOR;
	char text[200];

	(void)snprintf(text, sizeof(text),
		       "firmware %d.%d.%d speaks protocol %d.%d, this lightprobed %d.%d — %s",
		       hello->firmware_major, hello->firmware_minor, hello->firmware_patch,
		       hello->protocol_major, hello->protocol_minor, PROTOCOL_MAJOR, PROTOCOL_MINOR,
		       older ? "the firmware is older: lightprobe mcu flash"
			     : "the firmware is newer: install a newer lightprobe");
	connection_fault(mcu, id, "version", text);
}

static void refuse_version(struct lp_mcu *mcu, const struct mcu_hello_t *hello)
{
	connection_fault(mcu, "mcu-silent", "hello", NULL);
	connection_fault(mcu, "mcu-waiting", "hello", NULL);
	version_fault(mcu, hello, "mcu-version");
	close_link(mcu, REFUSED_NS);
}

static void accept_version(struct lp_mcu *mcu, const struct mcu_hello_t *hello)
{
	if (hello->protocol_minor != PROTOCOL_MINOR)
		version_fault(mcu, hello, "mcu-minor-version"); /* what both know is used */
	else
		connection_fault(mcu, "mcu-minor-version", "version", NULL);
	connection_fault(mcu, "mcu-version", "version", NULL);
	connection_fault(mcu, "mcu-silent", "hello", NULL);
	connection_fault(mcu, "mcu-waiting", "hello", NULL);
	lp_info(mcu->object, "hello", "firmware %d.%d.%d", hello->firmware_major,
		hello->firmware_minor, hello->firmware_patch);
	enter(mcu, LP_MCU_SETTING);
	ask_rates(mcu);
	mcu->t_next_ns += ASK_NS;
}

static void on_hello(struct lp_mcu *mcu, const uint8_t *payload)
{
	struct mcu_hello_t hello;

	mcu_hello_unpack(&hello, payload, LP_LINK_MAX_BYTES);
	if (is_echo(mcu, &hello))
		return;
	if (mcu->state != LP_MCU_GREETING ||
	    (mcu->was_found && hello.boot_count != mcu->boot_count))
		lp_warning(mcu->object, "reset",
			   "the microcontroller was reset (%s); the connection starts again",
			   lp_mcu_reset_cause(hello.reset_cause));
	forget(mcu);
	if (!mcu->was_found || hello.boot_count != mcu->boot_count)
		lp_mcu_was_reset(mcu, hello.reset_cause);
	mcu->boot_count = hello.boot_count;
	mcu->protocol_minor = hello.protocol_minor;
	if (hello.protocol_major == PROTOCOL_MAJOR)
		accept_version(mcu, &hello);
	else
		refuse_version(mcu, &hello);
}

static void report_refused(struct lp_mcu *mcu, uint8_t token)
{
	for (struct lp_mcu_user *user = mcu->users; user; user = user->next) {
		if (user->refused)
			user->refused(user, token, "out of the wheel's range");
	}
}

static void on_result(struct lp_mcu *mcu, const uint8_t *payload)
{
	struct mcu_result_t result;

	mcu_result_unpack(&result, payload, LP_LINK_MAX_BYTES);
	if (result.request == LP_MCU_ID(RATES) && mcu->state == LP_MCU_SETTING)
		found(mcu);
	else if (result.request == LP_MCU_ID(WHEEL_MOVE) &&
		 result.result == MCU_RESULT_RESULT_OUT_OF_RANGE_CHOICE)
		report_refused(mcu, result.token);
}

void lp_mcu_received(void *context, const struct lp_link_message *message, int64_t t_ns)
{
	struct lp_mcu *mcu = context;

	mcu->t_heard_ns = t_ns;
	if (message->id == LP_MCU_ID(HELLO))
		on_hello(mcu, message->payload);
	else if (message->id == LP_MCU_ID(RESULT))
		on_result(mcu, message->payload);
	else if (mcu->state == LP_MCU_READY)
		lp_mcu_report(mcu, message, t_ns);
}

void lp_mcu_lost(void *context, const char *stage, const char *reason)
{
	struct lp_mcu *mcu = context;

	connection_fault(mcu, "mcu-waiting", stage, reason);
	close_link(mcu, lp_backoff_next_ns(&mcu->retry));
}

void lp_mcu_link_fault(void *context, const char *id, const char *text)
{
	connection_fault(context, id, id, text);
}

/* ---------------------------------------------------------------- by time */

static void open_link(struct lp_mcu *mcu)
{
	const char *next_step = "";
	const int ret = mcu->link->ops->open(mcu->link, &next_step);
	char reason[300];

	if (ret < 0) {
		(void)snprintf(reason, sizeof(reason), "%s — %s", lp_strerror(ret), next_step);
		connection_fault(mcu, "mcu-waiting", "open", reason);
		mcu->t_next_ns = lp_clock_ns() + lp_backoff_next_ns(&mcu->retry);
		return;
	}
	enter(mcu, LP_MCU_GREETING); /* what is open need not work: the fault stays until it does */
}

static void greet(struct lp_mcu *mcu, int64_t now_ns)
{
	if (now_ns - mcu->t_state_ns < GREETING_NS) {
		ask_hello(mcu, now_ns);
		mcu->t_next_ns = now_ns + ASK_NS;
		return;
	}
	connection_fault(mcu, "mcu-waiting", "hello", NULL);
	connection_fault(
		mcu, "mcu-silent", "hello",
		"no answer in 5 s — check device and carrier strap; is the firmware flashed?");
	close_link(mcu, lp_backoff_next_ns(&mcu->retry));
}

static void serve(struct lp_mcu *mcu, int64_t now_ns)
{
	const int64_t time_ns = mcu->clock.count < FAST_EXCHANGES ? TIME_FAST_NS : TIME_SLOW_NS;

	if (now_ns - mcu->t_heard_ns > SILENCE_NS) {
		connection_fault(
			mcu, "mcu-silent", "receive",
			"no message for 2 s — check power and cable of the microcontroller");
		forget(mcu);
		enter(mcu, LP_MCU_GREETING);
		return;
	}
	if (now_ns - mcu->t_time_ns >= time_ns)
		lp_mcu_ask_time(mcu);
	lp_mcu_clear_faults(mcu, now_ns);
}

void lp_mcu_tick(struct lp_timer *timer)
{
	struct lp_mcu *mcu = LP_CONTAINER_OF(timer, struct lp_mcu, tick);
	const int64_t now_ns = lp_clock_ns();

	if (mcu->state == LP_MCU_READY) {
		serve(mcu, now_ns);
	} else if (now_ns < mcu->t_next_ns) {
		return;
	} else if (mcu->state == LP_MCU_CLOSED) {
		open_link(mcu);
	} else if (mcu->state == LP_MCU_GREETING) {
		greet(mcu, now_ns);
	} else if (now_ns - mcu->t_state_ns > GREETING_NS) {
		enter(mcu, LP_MCU_GREETING);
	} else {
		ask_rates(mcu);
		mcu->t_next_ns = now_ns + ASK_NS;
	}
}
