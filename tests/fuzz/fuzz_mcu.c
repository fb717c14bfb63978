/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The whole firmware on the host board, fed with what a hostile or broken line may carry. Input: a
 * byte that chooses the carrier, then (kind, length, bytes) pieces: bytes on the line, whole
 * messages with a right envelope, time, faults of the box. Beside what the sanitizers see, the
 * pulses must stay within the servo's limits.
 */
#include <string.h>

#include "board/host/host.h"
#include "firmware.h"
#include "fuzz.h"

#define MOST_BYTES 512
#define MOST_MS 2000 /* of one input, simulated */

static struct firmware firmware;
static unsigned left_ms;

static void run_ms(unsigned ms)
{
	for (; ms > 0 && left_ms > 0; ms--, left_ms--) {
		host_pass(1000);
		firmware_poll(&firmware);
		if (host.reset_asked) {
			memset(&firmware, 0, sizeof(firmware));
			firmware_start(&firmware);
		}
		fuzz_assert(host.servo_half_us == 0 ||
			    (host.servo_half_us >= 600 && host.servo_half_us <= 5400));
	}
}

/* A message with a right envelope reaches the handlers however its bytes came about. */
static void send_message(const uint8_t *bytes, size_t count)
{
	struct message message = {.id = count ? bytes[0] & 0x0F : 0};
	uint8_t frame[ENVELOPE_MAX_BYTES + 2];

	message.length_bytes = count > 9 ? 8 : count ? count - 1 : 0;
	if (count > 1)
		memcpy(message.payload, bytes + 1, message.length_bytes);
	if (host.carrier == CARRIER_SERIAL) {
		host_send(frame, link_serial_encode(&message, frame));
	} else {
		host.mail_in[0] = envelope_pack(&message, host.mail_in + 1);
		host.mail_in_count = host.mail_in[0] + 1;
		host.mail_waits = true;
	}
}

static void send_bytes(const uint8_t *bytes, size_t count)
{
	host_send(bytes, count);
	host.mail_in_count = count > BOARD_MAIL_BYTES ? BOARD_MAIL_BYTES : count;
	memcpy(host.mail_in, bytes, host.mail_in_count);
	host.mail_waits = host.mail_in_count > 0;
	host.mail_offered = false;
}

static const uint8_t *spi_bytes;
static size_t spi_left;

static uint8_t on_spi(void *context, uint8_t byte)
{
	(void)context, (void)byte;
	if (!spi_left)
		return 0;
	spi_left--;
	return *spi_bytes++;
}

static void disturb(uint8_t what)
{
	struct world *world = &host.world;

	world->stuck = what & 1;
	world->slow = what & 2 ? 0.2 : 1;
	world->slip_deg = (what >> 2 & 3) * 10;
	world->index_a_forced = what & 16 ? 0 : -1;
	world->index_glitches = what & 32 ? 5 : 0;
	world->supply_mv = what & 64 ? 4000 : 5000;
	world->feedback_fitted = what >> 7;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	if (size < 1)
		return 0;
	if (size > MOST_BYTES)
		size = MOST_BYTES;
	left_ms = MOST_MS;
	host_init(1);
	host.carrier = data[0] % 3;
	host.spi = on_spi;
	host.can_waiting = true;
	spi_bytes = data;
	spi_left = size;
	memset(&firmware, 0, sizeof(firmware));
	firmware_start(&firmware);
	for (size_t at = 1; at + 2 <= size;) {
		uint8_t kind = data[at], count = data[at + 1];
		at += 2;
		if (count > size - at)
			count = size - at;
		if (kind % 4 == 0)
			send_bytes(data + at, count);
		else if (kind % 4 == 1)
			send_message(data + at, count);
		else if (kind % 4 == 2)
			run_ms(kind * 4);
		else
			disturb(kind >> 2 | count << 6);
		run_ms(2);
		at += kind % 4 < 2 ? count : 0;
	}
	run_ms(20);
	return 0;
}
