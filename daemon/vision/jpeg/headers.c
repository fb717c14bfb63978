/* SPDX-License-Identifier: Apache-2.0 */
/* Marker segments of a JPEG (ITU-T T.81, annex B), every read bounded. */
#include "vision/jpeg/blocks.h"

#include <errno.h>
#include <string.h>

enum marker {
	SOF0 = 0xc0,
	SOF1 = 0xc1,
	SOF15 = 0xcf,
	DHT = 0xc4,
	JPG = 0xc8,
	DAC = 0xcc,
	RST0 = 0xd0,
	RST7 = 0xd7,
	SOI = 0xd8,
	EOI = 0xd9,
	SOS = 0xda,
	DQT = 0xdb,
	DRI = 0xdd,
	APP14 = 0xee,
	TEM = 0x01,
};

struct segment {
	const uint8_t *data;
	size_t size;
};

static int read_quantisation(struct lp_jpeg_reader *reader, struct segment s)
{
	while (s.size) {
		const int wide = s.data[0] >> 4, table = s.data[0] & 15;
		const size_t need = 1 + (wide ? 128 : 64);

		if (wide > 1 || table > 3 || s.size < need)
			return -EBADMSG;
		for (int k = 0; k < 64; k++)
			reader->quant[table][k] =
				wide ? (uint16_t)(s.data[1 + 2 * k] << 8 | s.data[2 + 2 * k])
				     : s.data[1 + k];
		reader->quant_defined[table] = true;
		s.data += need;
		s.size -= need;
	}
	return 0;
}

static int build_tables(struct lp_jpeg_reader *reader)
{
	const uint8_t *p = reader->dht;
	size_t left = reader->dht_size;

	for (int t = 0; t < 2; t++)
		reader->dc_table[t].code.defined = reader->ac_table[t].code.defined = false;
	while (left) {
		const int ac = p[0] >> 4, table = p[0] & 15;
		size_t values = 0;
		int ret;

		if (left < 17)
			return -EBADMSG;
		if (ac > 1 || table > 3)
			return -EBADMSG;
		if (table > 1)
			return -ENOTSUP;
		for (int k = 1; k <= 16; k++)
			values += p[k];
		if (values > 256 || left < 17 + values)
			return -EBADMSG;
		ret = ac ? lp_huffman_ac_build(&reader->ac_table[table], p + 1, p + 17)
			 : lp_huffman_dc_build(&reader->dc_table[table], p + 1, p + 17);
		if (ret < 0)
			return ret;
		p += 17 + values;
		left -= 17 + values;
	}
	return 0;
}

/* Tables are rebuilt only when the frame brings other ones than the last frame did. */
static int use_tables(struct lp_jpeg_reader *reader, const uint8_t *dht, size_t size)
{
	int ret;

	if (size ? size == reader->dht_size && !memcmp(dht, reader->dht, size)
		 : reader->dht_standard)
		return 0;
	memset(reader->head_built, 0, sizeof(reader->head_built));
	if (!size) {
		for (int t = 0; t < 2; t++) {
			lp_huffman_dc_standard(&reader->dc_table[t], t);
			lp_huffman_ac_standard(&reader->ac_table[t], t);
		}
		reader->dht_standard = true;
		reader->dht_size = 0;
		return 0;
	}
	memcpy(reader->dht, dht, size);
	reader->dht_size = size;
	reader->dht_standard = false;
	ret = build_tables(reader);
	if (ret < 0)
		reader->dht_size = 0;
	return ret;
}

static int read_frame_header(struct lp_jpeg_reader *reader, struct segment s)
{
	if (reader->component_count || s.size < 6)
		return -EBADMSG;
	if (s.data[0] != 8)
		return -ENOTSUP;
	reader->height_px = s.data[1] << 8 | s.data[2];
	reader->width_px = s.data[3] << 8 | s.data[4];
	reader->component_count = s.data[5];
	if (!reader->width_px || !reader->component_count ||
	    s.size != 6 + 3 * (size_t)reader->component_count)
		return -EBADMSG;
	if (!reader->height_px || reader->width_px > LP_JPEG_MAX_SIDE_PX ||
	    reader->height_px > LP_JPEG_MAX_SIDE_PX)
		return -ENOTSUP; /* DNL, or beyond what memory is kept for */
	if (reader->component_count != 1 && reader->component_count != 3)
		return -ENOTSUP;
	for (int k = 0; k < reader->component_count; k++) {
		struct lp_jpeg_component *c = &reader->component[k];
		const uint8_t *p = s.data + 6 + 3 * k;

		c->id = p[0];
		c->h = p[1] >> 4;
		c->v = p[1] & 15;
		c->quant_table = p[2];
		if (!c->h || !c->v || c->h > 4 || c->v > 4 || c->quant_table > 3)
			return -EBADMSG;
		for (int j = 0; j < k; j++)
			if (reader->component[j].id == c->id)
				return -EBADMSG;
	}
	return 0;
}

/* Luma 1x1, 2x1, 1x2 or 2x2 with chroma 1x1; a lone component has one block per MCU. */
static int check_sampling(struct lp_jpeg_reader *reader)
{
	struct lp_jpeg_component *c = reader->component;

	if (reader->component_count == 1) {
		c[0].h = c[0].v = 1;
		return 0;
	}
	if (c[0].h > 2 || c[0].v > 2 || c[1].h != 1 || c[1].v != 1 || c[2].h != 1 || c[2].v != 1)
		return -ENOTSUP;
	/* as libjpeg guesses colour: an Adobe marker or component names tell RGB from YCbCr */
	if (reader->adobe_transform == 0 ||
	    (reader->adobe_transform < 0 && c[0].id == 'R' && c[1].id == 'G' && c[2].id == 'B'))
		return -ENOTSUP;
	return 0;
}

static int read_scan_header(struct lp_jpeg_reader *reader, struct segment s)
{
	if (!reader->component_count || s.size < 1)
		return -EBADMSG;
	if (s.data[0] < 1 || s.data[0] > 4 || s.size != 4 + 2 * (size_t)s.data[0])
		return -EBADMSG;
	if (s.data[0] != reader->component_count)
		return -ENOTSUP; /* one scan per component */
	for (int k = 0; k < reader->component_count; k++) {
		struct lp_jpeg_component *c = &reader->component[k];
		const uint8_t *p = s.data + 1 + 2 * k;

		if (p[0] != c->id)
			return -EBADMSG;
		c->dc_table = p[1] >> 4;
		c->ac_table = p[1] & 15;
		if (c->dc_table > 3 || c->ac_table > 3)
			return -EBADMSG;
		if (c->dc_table > 1 || c->ac_table > 1)
			return -ENOTSUP;
	}
	return 0;
}

/* What a scan refers to must be there; the heads of its blocks are prepared. */
static int check_tables(struct lp_jpeg_reader *reader)
{
	for (int k = 0; k < reader->component_count; k++) {
		const struct lp_jpeg_component *c = &reader->component[k];

		if (!reader->quant_defined[c->quant_table] ||
		    !reader->dc_table[c->dc_table].code.defined ||
		    !reader->ac_table[c->ac_table].code.defined)
			return -EBADMSG;
		bool *built = &reader->head_built[c->dc_table][c->ac_table];

		if (!*built)
			lp_huffman_heads(&reader->dc_table[c->dc_table].code,
					 &reader->ac_table[c->ac_table].code,
					 &reader->head[c->dc_table][c->ac_table]);
		*built = true;
	}
	return 0;
}

/* DHT segments are gathered, to be compared with the last frame's as one string. */
struct gathered {
	uint8_t bytes[sizeof(((struct lp_jpeg_reader *)0)->dht)];
	size_t size;
};

static int read_segment(struct lp_jpeg_reader *reader, int marker, struct segment s,
			struct gathered *dht)
{
	switch (marker) {
	case DQT:
		return read_quantisation(reader, s);
	case DHT:
		if (s.size > sizeof(dht->bytes) - dht->size)
			return -EBADMSG;
		memcpy(dht->bytes + dht->size, s.data, s.size);
		dht->size += s.size;
		return 0;
	case SOF0:
	case SOF1:
		return read_frame_header(reader, s);
	case DRI:
		if (s.size != 2)
			return -EBADMSG;
		reader->restart_interval = s.data[0] << 8 | s.data[1];
		return 0;
	case APP14:
		if (s.size >= 12 && !memcmp(s.data, "Adobe", 5))
			reader->adobe_transform = s.data[11];
		return 0;
	case DAC:
		return -ENOTSUP;
	default:
		return marker > SOF1 && marker <= SOF15 && marker != JPG ? -ENOTSUP : 0;
	}
}

long lp_jpeg_parse_headers(struct lp_jpeg_reader *reader, const uint8_t *data, size_t size_bytes)
{
	struct gathered dht;
	size_t at = 2;
	int ret;

	dht.size = 0;
	reader->component_count = 0;
	reader->restart_interval = 0;
	reader->adobe_transform = -1;
	memset(reader->quant_defined, 0, sizeof(reader->quant_defined));
	if (size_bytes < 4 || data[0] != 0xff || data[1] != SOI)
		return -EBADMSG;
	while (size_bytes - at >= 4) {
		const int marker = data[at + 1];

		if (data[at] != 0xff)
			return -EBADMSG;
		if (marker == 0xff) { /* fill byte */
			at++;
			continue;
		}
		if (marker == TEM || (marker >= RST0 && marker <= SOI)) {
			at += 2;
			continue;
		}
		if (marker == EOI || marker == 0)
			return -EBADMSG;

		const size_t length = (size_t)data[at + 2] << 8 | data[at + 3];
		if (length < 2 || length > size_bytes - at - 2)
			return -EBADMSG;
		const struct segment s = {data + at + 4, length - 2};

		at += 2 + length;
		if (marker != SOS) {
			ret = read_segment(reader, marker, s, &dht);
			if (ret < 0)
				return ret;
			continue;
		}
		ret = read_scan_header(reader, s);
		if (ret == 0)
			ret = check_sampling(reader);
		if (ret == 0)
			ret = use_tables(reader, dht.bytes, dht.size);
		if (ret == 0)
			ret = check_tables(reader);
		return ret < 0 ? ret : (long)at;
	}
	return -EBADMSG;
}
