/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the microcontroller may send: through the serial reader and the session into the wheel and
 * the ring. Only the tty is left out (drivers/link/serial.c), and time is the input's. Input:
 * (kind, count) pieces, some followed by count bytes: bytes on the line, whole messages with a
 * right envelope, time, commands, the line going away.
 */
#include <errno.h>
#include <math.h>
#include <string.h>

#include "app/backends.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "drivers/link/envelope.h"
#include "drivers/link/mcu_parts.h"
#include "fuzz.h"
#include "include/ring.h"
#include "include/ring_sample.h"
#include "include/rotator.h"

#define MOST_BYTES 4096
#define TICK_NS (20 * LP_NS_PER_MS)
#define FIRST_ID 0x40 /* of the microcontroller's messages; 16 follow */

static int64_t now_ns; /* simulated: a fault shows the same way every time */

static void set_time(int64_t t_ns)
{
	now_ns = t_ns;
	lp_clock_simulate(t_ns);
}

/* ---------------------------------------------------------------- the line */

static struct line {
	struct lp_link base;
	struct lp_serial_reader reader;
	bool open, absent;
} line;

static int line_open(struct lp_link *link, const char **reason)
{
	(void)link;
	if (line.absent) {
		*reason = "is it plugged in?";
		return -ENODEV;
	}
	memset(&line.reader, 0, sizeof(line.reader));
	line.open = true;
	return 0;
}

static int line_send(struct lp_link *link, const struct lp_link_message *message)
{
	uint8_t frame[LP_SERIAL_FRAME_MAX_BYTES];
	size_t count;

	(void)link;
	if (!line.open)
		return -EAGAIN;
	fuzz_assert(message->length_bytes <= LP_LINK_MAX_BYTES && message->id < FIRST_ID);
	count = lp_serial_pack(message, frame);
	fuzz_assert(memchr(frame, 0, count) == frame + count - 1);
	return 0;
}

static void line_close(struct lp_link *link)
{
	(void)link;
	line.open = false;
}

static const struct lp_link_ops line_ops = {
	.open = line_open,
	.send = line_send,
	.close = line_close,
	.destroy = line_close,
};

/* As serial.c does: handing a message on may close the line. */
static void receive(const uint8_t *bytes, size_t count)
{
	const struct lp_link_host *host = &line.base.host;
	struct lp_link_message message;

	for (size_t i = 0; i < count && line.open; i++) {
		if (!lp_serial_read(&line.reader, bytes[i], &message))
			continue;
		fuzz_assert(message.length_bytes == lp_link_length(message.id));
		host->received(host->context, &message, now_ns);
	}
}

static void receive_message(const uint8_t *bytes, size_t count)
{
	struct lp_link_message message = {.id = FIRST_ID + (count ? bytes[0] & 0x0F : 0)};
	const int length_bytes = lp_link_length(message.id);
	uint8_t frame[LP_SERIAL_FRAME_MAX_BYTES];

	if (length_bytes < 0 || count == 0)
		return;
	message.length_bytes = (uint8_t)length_bytes;
	count--;
	memcpy(message.payload, bytes + 1,
	       count < message.length_bytes ? count : message.length_bytes);
	receive(frame, lp_serial_pack(&message, frame));
}

static void lose_line(bool absent)
{
	const struct lp_link_host *host = &line.base.host;

	line.absent = absent;
	if (line.open)
		host->lost(host->context, "read", "the device is gone");
}

/* ---------------------------------------------------------------- what comes of it */

static bool is_angle(float deg)
{
	return isnan(deg) || fabsf(deg) <= 327.68F;
}

static void on_state(void *context, const struct lp_wheel_state *state)
{
	(void)context;
	fuzz_assert(state->phase <= LP_WHEEL_ABSENT);
	fuzz_assert(is_angle(state->commanded_deg) && is_angle(state->measured_deg));
	fuzz_assert(!(state->sigma_deg < 0) && !(state->clock_sigma_us < 0));
	fuzz_assert(state->t_phase_ns <= now_ns && state->t_seen_ns <= now_ns);
	if (state->phase == LP_WHEEL_ABSENT)
		fuzz_assert(isnan(state->measured_deg) && isnan(state->commanded_deg));
}

static void on_sample(void *context, const struct lp_ring_sample *sample)
{
	(void)context;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const float lux = sample->illuminance_lux[k];

		fuzz_assert(isnan(lux) || (lux >= 0 && isfinite(lux)));
	}
}

static void on_fault(void *context, const char *id, const char *text)
{
	(void)context;
	fuzz_assert(*id != '\0' && (!text || *text != '\0'));
}

/* ---------------------------------------------------------------- a run */

static struct lp_loop *loop;
static struct lp_connections connections;
static struct lp_rotator *rotator;
static struct lp_ring *ring;

static struct lp_mcu *mcu(void)
{
	return (struct lp_mcu *)connections.first;
}

static void setup(void)
{
	static const char uri[] = "mcu:serial:fuzz"; /* never opened: see below */
	struct lp_rotator_host wheel_host = {.state = on_state,
					     .fault = on_fault,
					     .connections = &connections};
	struct lp_ring_host ring_host = {.sample = on_sample,
					 .fault = on_fault,
					 .connections = &connections};

	lp_log_set_level(LP_LOG_ERROR);
	set_time(10000 * LP_NS_PER_S);
	fuzz_assert(lp_loop_create(&loop) == 0);
	wheel_host.loop = ring_host.loop = loop;
	fuzz_assert(lp_rotator_open(uri, &wheel_host, &rotator) == 0);
	fuzz_assert(lp_ring_open(uri, &ring_host, &ring) == 0);
	memset(&line, 0, sizeof(line));
	line.base = *mcu()->link;
	line.base.ops = &line_ops;
	mcu()->link->ops->destroy(mcu()->link);
	mcu()->link = &line.base;
}

static void pass(unsigned ticks)
{
	for (; ticks > 0; ticks--) {
		set_time(now_ns + TICK_NS);
		lp_mcu_tick(&mcu()->tick);
	}
}

static void move(unsigned part)
{
	rotator->ops->move(rotator, (float)part * 1.5F);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	if (size > MOST_BYTES)
		size = MOST_BYTES;
	setup();
	pass(2); /* opened and greeted */
	for (size_t at = 0; at + 2 <= size;) {
		const uint8_t kind = data[at] % 6;
		size_t count = data[at + 1];

		at += 2;
		if (kind < 2 && count > size - at)
			count = size - at;
		if (kind == 0)
			receive(data + at, count);
		else if (kind == 1)
			receive_message(data + at, count);
		else if (kind == 2)
			pass((unsigned)count);
		else if (kind == 3)
			move((unsigned)count);
		else if (kind == 4)
			rotator->ops->look(rotator);
		else
			lose_line(count & 1);
		set_time(now_ns + LP_NS_PER_MS);
		at += kind < 2 ? count : 0;
	}
	pass(2);
	rotator->ops->destroy(rotator);
	ring->ops->destroy(ring);
	fuzz_assert(connections.first == NULL);
	lp_loop_destroy(loop);
	return 0;
}
