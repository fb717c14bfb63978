/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How messages travel to and from the microcontroller (proto/mcu.md): one file
 * <carrier>.c each. Single messages of an id and up to eight bytes; what they mean is
 * mcu_*.c's. All on the loop thread; nothing blocks.
 */
#ifndef LP_LINK_CARRIER_H
#define LP_LINK_CARRIER_H

#include <stdbool.h>
#include <stdint.h>

#define LP_LINK_MAX_BYTES 8

struct lp_link;
struct lp_loop;

struct lp_link_message {
	uint8_t id; /* as on serial and I2C; the CAN identifier minus 0x500 */
	uint8_t length_bytes;
	uint8_t payload[LP_LINK_MAX_BYTES];
};

/* Of all carriers together; each reads its own. */
struct lp_link_settings {
	int baud;    /* serial */
	int address; /* I2C */
};

struct lp_link_host {
	void *context;
	struct lp_loop *loop; /* outlives the link */
	/* t_ns: CLOCK_MONOTONIC, when it had come. */
	void (*received)(void *context, const struct lp_link_message *message, int64_t t_ns);
	/* The device is gone: close() and open() again, later. Last call before either. */
	void (*lost)(void *context, const char *stage, const char *reason);
	/* A fault of the carrier by name; text NULL: it is over. The link goes on by itself. */
	void (*fault)(void *context, const char *id, const char *text);
};

struct lp_link_ops {
	const char *scheme;
	/* `device` is copied. 0, -ENOMEM, -ENAMETOOLONG. */
	int (*create)(const char *device, const struct lp_link_settings *settings,
		      const struct lp_link_host *host, struct lp_link **link);
	/* 0, or -errno with *reason (static) as the next step. Nothing is left open then. */
	int (*open)(struct lp_link *link, const char **reason);
	/* -EAGAIN: not now, the message is lost; a broken link shows through lost(). */
	int (*send)(struct lp_link *link, const struct lp_link_message *message);
	void (*close)(struct lp_link *link); /* does nothing when it is not open */
	void (*destroy)(struct lp_link *link);
};

/* Base of every carrier: embed it as the first member. */
struct lp_link {
	const struct lp_link_ops *ops;
	struct lp_link_host host;
};

/* Length that belongs to an id of a message from the microcontroller; -1: no such message. */
int lp_link_length(uint8_t id);

extern const struct lp_link_ops lp_link_serial_ops;
extern const struct lp_link_ops lp_link_i2c_ops;
extern const struct lp_link_ops lp_link_can_ops;

#endif
