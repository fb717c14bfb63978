/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A THETA X behind lp_ptp_usb_open(), which the linker wraps: as little of it as a source needs,
 * and some of its moods. It takes a still when the test sends one. The camera with all its moods,
 * on a real bus, is tests/kernel/guest/theta.py.
 */
#ifndef LP_FAKE_THETA_H
#define LP_FAKE_THETA_H

#include <errno.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "drivers/source/ptp/data.h"
#include "drivers/source/ptp/port.h"
#include "jpeg_encode.h"

#define FAKE_THETA_PACKET 512
#define FAKE_THETA_PROPERTIES 16
#define FAKE_THETA_QUEUE 64

struct fake_property {
	uint16_t code;
	size_t size_bytes;
	uint8_t value[512];
};

struct fake_transfer {
	uint8_t data[16384];
	size_t size_bytes, at;
	bool is_full; /* its last packet: an empty one follows */
};

static struct {
	pthread_mutex_t lock;
	bool plugged;
	char queue[FAKE_THETA_QUEUE + 1]; /* stills that it will take: G(ood), C(orrupt) */
	struct fake_property properties[FAKE_THETA_PROPERTIES];
	const char *model, *version;
	uint16_t refused;   /* property that cannot be set; 0: none */
	int busy;	    /* answers in a row that it is busy, to captures and objects */
	bool has_session;   /* somebody has left one open */
	bool stale;	    /* an answer to an earlier question comes before the next */
	bool split;	    /* headers of data come in a packet of their own */
	int sessions, sets; /* begun */
	int deleted;
	unsigned stills; /* ever taken */

	int left;	 /* stills of the set under way; -1: none is */
	bool is_corrupt; /* the last one */
	uint16_t command;
	uint32_t transaction, parameter;
	struct fake_transfer transfers[4];
	int first, count;
	uint8_t *jpeg;
	unsigned long jpeg_bytes;
	struct lp_ptp_port port;
} fake_theta = {.lock = PTHREAD_MUTEX_INITIALIZER};

#define FAKE_THETA_LOCKED(statement)                    \
	do {                                            \
		pthread_mutex_lock(&fake_theta.lock);   \
		statement;                              \
		pthread_mutex_unlock(&fake_theta.lock); \
	} while (0)

static inline struct fake_property *fake_theta_property(uint16_t code)
{
	for (int i = 0; i < FAKE_THETA_PROPERTIES; i++)
		if (fake_theta.properties[i].code == code)
			return &fake_theta.properties[i];
	return NULL;
}

/* ---------------------------------------------------------------- answers */

static inline void fake_theta_answer(const uint8_t *data, size_t size_bytes, bool ends)
{
	struct fake_transfer *transfer =
		&fake_theta.transfers[(fake_theta.first + fake_theta.count++) % 4];

	assert_true(size_bytes <= sizeof(transfer->data));
	memcpy(transfer->data, data, size_bytes);
	transfer->size_bytes = size_bytes;
	transfer->at = 0;
	transfer->is_full = ends && size_bytes % FAKE_THETA_PACKET == 0;
}

static inline uint8_t *fake_theta_header(uint8_t *at, size_t bytes, int type, int code)
{
	at = lp_ptp_write(at, bytes, 4);
	at = lp_ptp_write(at, (uint64_t)type, 2);
	at = lp_ptp_write(at, (uint64_t)code, 2);
	return lp_ptp_write(at, fake_theta.transaction, 4);
}

static inline void fake_theta_respond(int code)
{
	uint8_t data[12];

	fake_theta_header(data, sizeof(data), 3, code);
	fake_theta_answer(data, sizeof(data), true);
}

static inline void fake_theta_give(const uint8_t *payload, size_t size_bytes)
{
	uint8_t data[16384], *at;

	assert_true(size_bytes + 12 <= sizeof(data));
	at = fake_theta_header(data, size_bytes + 12, 2, fake_theta.command);
	memcpy(at, payload, size_bytes);
	if (fake_theta.split) {
		fake_theta_answer(data, 12, true);
		fake_theta_answer(payload, size_bytes, true);
	} else {
		fake_theta_answer(data, size_bytes + 12, true);
	}
	fake_theta_respond(0x2001);
}

static inline uint8_t *fake_theta_text(uint8_t *at, const char *text)
{
	const size_t length = strlen(text) + 1;

	*at++ = (uint8_t)length;
	for (size_t i = 0; i < length; i++)
		at = lp_ptp_write(at, (uint64_t)text[i], 2);
	return at;
}

static inline void fake_theta_give_info(void)
{
	uint8_t data[1024], *at = lp_ptp_write(data, 0, 8);

	at = lp_ptp_write(at, 0, 1); /* no text of the extension */
	at = lp_ptp_write(at, 0, 2);
	at = lp_ptp_write(at, 1, 4); /* operations */
	at = lp_ptp_write(at, 0x101C, 2);
	at = lp_ptp_write(at, 0, 4); /* events */
	at = lp_ptp_write(at, FAKE_THETA_PROPERTIES, 4);
	for (int i = 0; i < FAKE_THETA_PROPERTIES; i++)
		at = lp_ptp_write(at, fake_theta.properties[i].code, 2);
	at = lp_ptp_write(at, 0, 4);
	at = lp_ptp_write(at, 0, 4);
	at = fake_theta_text(at, "Ricoh Company, Ltd.");
	at = fake_theta_text(at, fake_theta.model);
	at = fake_theta_text(at, fake_theta.version);
	at = fake_theta_text(at, "00000042");
	fake_theta_give(data, (size_t)(at - data));
}

static inline void fake_theta_give_list(uint16_t code)
{
	static const uint64_t shutters[] = {0,
					    1ULL << 32 | 16000,
					    1ULL << 32 | 2000,
					    1ULL << 32 | 250,
					    10ULL << 32 | 25,
					    2ULL << 32 | 1};
	static const uint64_t isos[] = {200, 50, 100, 0xffff};
	const bool is_shutter = code == 0xD00F;
	const int bytes = is_shutter ? 8 : 2, count = is_shutter ? 6 : 4;
	uint8_t data[256], *at = lp_ptp_write(data, code, 2);

	at = lp_ptp_write(at, is_shutter ? 8 : 4, 2);
	at = lp_ptp_write(at, 1, 1);
	at = lp_ptp_write(at, 0, bytes);
	at = lp_ptp_write(at, 0, bytes);
	at = lp_ptp_write(at, 2, 1);
	at = lp_ptp_write(at, (uint64_t)count, 2);
	for (int i = 0; i < count; i++)
		at = lp_ptp_write(at, is_shutter ? shutters[i] : isos[i], bytes);
	fake_theta_give(data, (size_t)(at - data));
}

/* The still, whose Exif says the exposure of its place in the bracket. */
static inline void fake_theta_give_still(void)
{
	static const uint8_t head[] = {0xff, 0xd8, 0xff, 0xe1, 0, 8 + 70};
	const uint8_t *bracket = fake_theta_property(0xD812)->value;
	const unsigned exposures = bracket[0] / 2, k = (fake_theta.stills - 1) % exposures;
	struct lp_ptp_reader reader = lp_ptp_reader_of(bracket + 4 + 32 * (size_t)k + 2, 10);
	const uint64_t iso = lp_ptp_read(&reader, 2), shutter = lp_ptp_read(&reader, 8);
	uint8_t data[8192], *at = data, *tiff;

	memcpy(at, head, sizeof(head));
	at += sizeof(head);
	memcpy(at, "Exif\0", 6);
	tiff = at += 6;
	memcpy(at, "II*\0\x08\0\0\0", 8);
	at = lp_ptp_write(at + 8, 1, 2); /* a directory of one entry: where the other is */
	at = lp_ptp_write(at, 0x8769 | 4 << 16 | 1ULL << 32, 8);
	at = lp_ptp_write(at, 26, 4);
	at = lp_ptp_write(at, 0, 4);
	at = lp_ptp_write(at, 2, 2); /* at 26 */
	at = lp_ptp_write(at, 0x829A | 5 << 16 | 1ULL << 32, 8);
	at = lp_ptp_write(at, 56, 4);
	at = lp_ptp_write(at, 0x8827 | 3 << 16 | 1ULL << 32, 8);
	at = lp_ptp_write(at, iso, 4);
	at = lp_ptp_write(at, 0, 4);
	at = lp_ptp_write(at, shutter >> 32, 4); /* at 56 */
	at = lp_ptp_write(at, shutter & UINT32_MAX, 4);
	at = tiff + 70;
	memcpy(at, fake_theta.jpeg + 2, fake_theta.jpeg_bytes - 2);
	at += fake_theta.jpeg_bytes - 2;
	fake_theta_give(data, (size_t)(at - data) / (fake_theta.is_corrupt ? 2 : 1));
}

static inline bool fake_theta_is_busy(void)
{
	if (fake_theta.busy <= 0)
		return false;
	fake_theta.busy--;
	fake_theta_respond(0x2019);
	return true;
}

static inline void fake_theta_on_command(void)
{
	const struct fake_property *property = fake_theta_property((uint16_t)fake_theta.parameter);
	uint8_t info[64] = {0};

	switch (fake_theta.command) {
	case 0x1001:
		fake_theta_give_info();
		break;
	case 0x1002:
		fake_theta_respond(fake_theta.has_session ? 0x201E : 0x2001);
		fake_theta.sessions += !fake_theta.has_session;
		fake_theta.has_session = true;
		break;
	case 0x1003:
		fake_theta.has_session = false;
		fake_theta_respond(0x2001);
		break;
	case 0x1008:
		lp_ptp_write(info + 4, 0x3801, 2);
		if (!fake_theta_is_busy())
			fake_theta_give(info, sizeof(info));
		break;
	case 0x1009:
		if (!fake_theta_is_busy())
			fake_theta_give_still();
		break;
	case 0x100B:
		fake_theta.deleted++;
		fake_theta_respond(0x2001);
		break;
	case 0x1014:
		fake_theta_give_list((uint16_t)fake_theta.parameter);
		break;
	case 0x1015:
		if (property)
			fake_theta_give(property->value, property->size_bytes);
		else
			fake_theta_respond(0x200A);
		break;
	case 0x1018:
		fake_theta.left = 0;
		fake_theta_respond(0x2001);
		break;
	case 0x101C:
		if (fake_theta_is_busy())
			break;
		fake_theta.left = fake_theta_property(0xD812)->value[0] / 2;
		fake_theta.sets++;
		fake_theta_respond(0x2001);
		break;
	default:
		fake_theta_respond(0x2005);
	}
}

/* ---------------------------------------------------------------- the port */

static inline void fake_theta_on_value(const uint8_t *data, size_t size_bytes)
{
	struct fake_property *property = fake_theta_property((uint16_t)fake_theta.parameter);

	if (!property) {
		fake_theta_respond(0x200A);
	} else if (property->code == fake_theta.refused) {
		fake_theta_respond(0x201C);
	} else {
		memcpy(property->value, data, size_bytes);
		property->size_bytes = size_bytes;
		fake_theta_respond(0x2001);
	}
}

static inline int fake_theta_send_bulk(struct lp_ptp_port *port, const uint8_t *data,
				       size_t size_bytes, int timeout_ms)
{
	struct lp_ptp_reader reader = lp_ptp_reader_of(data, size_bytes);
	int ret = 0, type;

	(void)port;
	(void)timeout_ms;
	pthread_mutex_lock(&fake_theta.lock);
	ret = fake_theta.plugged ? 0 : -ENODEV;
	assert_int_equal(lp_ptp_read(&reader, 4), size_bytes);
	type = (int)lp_ptp_read(&reader, 2);
	fake_theta.command = (uint16_t)lp_ptp_read(&reader, 2);
	fake_theta.transaction = (uint32_t)lp_ptp_read(&reader, 4);
	if (type == 1)
		fake_theta.parameter = size_bytes > 12 ? (uint32_t)lp_ptp_read(&reader, 4) : 0;
	if (fake_theta.stale && type == 1) {
		fake_theta.transaction--;
		fake_theta_respond(0x2001);
		fake_theta.transaction++;
		fake_theta.stale = false;
	}
	if (type == 2)
		fake_theta_on_value(reader.at, size_bytes - 12);
	else if (fake_theta.command != 0x1016)
		fake_theta_on_command();
	pthread_mutex_unlock(&fake_theta.lock);
	return ret;
}

static inline int fake_theta_receive(struct lp_ptp_port *port, uint8_t *data, size_t capacity_bytes,
				     int timeout_ms)
{
	struct fake_transfer *transfer;
	size_t got = 0;
	int ret;

	(void)port;
	assert_int_equal(capacity_bytes % FAKE_THETA_PACKET, 0); /* else a bus would overflow */
	pthread_mutex_lock(&fake_theta.lock);
	if (!fake_theta.plugged) {
		ret = -ENODEV;
	} else if (!fake_theta.count) {
		ret = -ETIMEDOUT;
	} else {
		transfer = &fake_theta.transfers[fake_theta.first];
		got = transfer->size_bytes - transfer->at;
		got = got < capacity_bytes ? got : capacity_bytes;
		memcpy(data, transfer->data + transfer->at, got);
		transfer->at += got;
		/* one that fills its last packet ends with an empty one */
		if (got < capacity_bytes ||
		    (transfer->at == transfer->size_bytes && !transfer->is_full)) {
			fake_theta.first = (fake_theta.first + 1) % 4;
			fake_theta.count--;
		}
		ret = (int)got;
	}
	pthread_mutex_unlock(&fake_theta.lock);
	if (ret == -ETIMEDOUT)
		usleep((useconds_t)timeout_ms * 1000);
	return ret;
}

static inline int fake_theta_make_event(uint8_t *data, int code, uint32_t parameter)
{
	lp_ptp_write(fake_theta_header(data, 16, 4, code), parameter, 4);
	return 16;
}

static inline int fake_theta_event(struct lp_ptp_port *port, uint8_t *data, size_t capacity_bytes,
				   int timeout_ms)
{
	int ret = -ETIMEDOUT;

	(void)port;
	(void)capacity_bytes;
	(void)timeout_ms;
	pthread_mutex_lock(&fake_theta.lock);
	if (!fake_theta.plugged) {
		ret = -ENODEV;
	} else if (fake_theta.left > 0 && *fake_theta.queue) {
		fake_theta.is_corrupt = *fake_theta.queue == 'C';
		memmove(fake_theta.queue, fake_theta.queue + 1, FAKE_THETA_QUEUE);
		fake_theta.left--;
		ret = fake_theta_make_event(data, 0x4002, ++fake_theta.stills);
	} else if (fake_theta.left == 0) {
		fake_theta.left = -1;
		ret = fake_theta_make_event(data, 0x400D, 0);
	} else if (fake_theta.sets % 2) { /* now and then something else */
		ret = fake_theta_make_event(data, 0x4006, 0xD808);
	}
	pthread_mutex_unlock(&fake_theta.lock);
	usleep(1000);
	return ret;
}

static inline void fake_theta_close(struct lp_ptp_port *port)
{
	(void)port;
}

int __wrap_lp_ptp_usb_open(const struct lp_ptp_settings *settings, struct lp_ptp_port **port,
			   struct lp_ptp_fault *fault);
int __wrap_lp_ptp_usb_open(const struct lp_ptp_settings *settings, struct lp_ptp_port **port,
			   struct lp_ptp_fault *fault)
{
	static const struct lp_ptp_port_ops ops = {.send = fake_theta_send_bulk,
						   .receive = fake_theta_receive,
						   .event = fake_theta_event,
						   .close = fake_theta_close};
	bool plugged;

	(void)settings;
	FAKE_THETA_LOCKED(plugged = fake_theta.plugged; fake_theta.count = 0);
	if (!plugged)
		return lp_ptp_fail(fault, -ENODEV, LP_SOURCE_WAITING, "find", "no RICOH THETA");
	fake_theta.port.ops = &ops;
	*port = &fake_theta.port;
	return 0;
}

/* ---------------------------------------------------------------- what a test does */

static inline void fake_theta_init(void)
{
	static const struct fake_property properties[FAKE_THETA_PROPERTIES] = {
		{0x5005, 2, {2}},	   {0x500E, 2, {2}},  {0x500F, 2, {0xff, 0xff}},
		{0x5012, 4, {2}},	   {0x5013, 2, {1}},  {0xD00F, 8, {0}},
		{0xD803, 2, {180}},	   {0xD808, 1, {0}},  {0xD812, 4, {0}},
		{0xD813, 2, {0x88, 0x13}}, {0xD81B, 4, {60}}, {0xD825, 1, {0}},
		{0xD827, 1, {0}},	   {0xD834, 2, {1}},  {0xD837, 2, {1}},
		{0xD83E, 1, {0}},
	};
	static const struct jpeg_kind kind = {.components = 3, .h = 2, .v = 2, .quality = 50};

	if (!fake_theta.jpeg)
		fake_theta.jpeg = encode_jpeg(&kind, 64, 32, &fake_theta.jpeg_bytes);
	memcpy(fake_theta.properties, properties, sizeof(properties));
	memset(fake_theta.queue, 0, sizeof(fake_theta.queue));
	fake_theta.model = "RICOH THETA X";
	fake_theta.version = "2.71.1";
	fake_theta.refused = 0;
	fake_theta.busy = fake_theta.sessions = fake_theta.sets = fake_theta.deleted = 0;
	fake_theta.has_session = fake_theta.stale = fake_theta.split = false;
	fake_theta.stills = 0;
	fake_theta.left = -1;
	fake_theta.plugged = false;
}

static inline void fake_theta_plug(void)
{
	FAKE_THETA_LOCKED(fake_theta.plugged = true; fake_theta.has_session = false;
			  fake_theta.left = -1; fake_theta.stills = 0; *fake_theta.queue = '\0');
}

static inline void fake_theta_unplug(void)
{
	FAKE_THETA_LOCKED(fake_theta.plugged = false);
}

static inline int fake_theta_get(const int *field)
{
	int value;

	FAKE_THETA_LOCKED(value = *field);
	return value;
}

/* False: not yet. */
static inline bool fake_theta_send(bool corrupt)
{
	bool taken;

	pthread_mutex_lock(&fake_theta.lock);
	taken = fake_theta.plugged && strlen(fake_theta.queue) < FAKE_THETA_QUEUE;
	if (taken)
		(void)strcat(fake_theta.queue, corrupt ? "C" : "G");
	pthread_mutex_unlock(&fake_theta.lock);
	return taken;
}

#endif
