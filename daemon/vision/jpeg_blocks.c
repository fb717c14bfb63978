/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/jpeg_blocks.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

/*
 * The longest MCU: 6 blocks of a DC (16 + 15 bits) and 63 AC symbols (16 + 15 bits) each. The
 * stream is padded by more than that, so bounds are checked once per MCU, and what lies between is
 * memory of ours.
 */
#define MAX_MCU_BYTES (6 * 64 * 31 / 8)
#define STREAM_PADDING_BYTES (2 * MAX_MCU_BYTES)
#define SEGMENT_GAP_BYTES 8
/* A window holds 56 bits when it is full. */
#define PROBES_PER_REFILL (56 / LP_PROBE_MAX_BITS)
#define PROBES_AFTER_HEAD ((56 - LP_HEAD_BITS) / LP_PROBE_MAX_BITS)

int lp_jpeg_reader_create(struct lp_jpeg_reader **reader)
{
	*reader = calloc(1, sizeof(**reader));
	return *reader ? 0 : -ENOMEM;
}

void lp_jpeg_reader_destroy(struct lp_jpeg_reader *reader)
{
	if (!reader)
		return;
	for (int c = 0; c < 3; c++)
		free(reader->component[c].dc);
	free(reader->energy);
	free(reader->stream);
	free(reader->segment_start);
	free(reader->mcu_bit);
	free(reader);
}

/* Room for `count` elements; contents are not kept. */
static int reserve(void *storage, size_t *capacity, size_t count, size_t element_bytes)
{
	void **p = storage;

	if (count <= *capacity)
		return 0;
	free(*p);
	*capacity = 0;
	*p = malloc(count * element_bytes);
	if (!*p)
		return -ENOMEM;
	*capacity = count;
	return 0;
}

static int reserve_blocks(struct lp_jpeg_reader *reader)
{
	const int h = reader->component[0].h, v = reader->component[0].v;
	const size_t luma_before = reader->block_capacity[0];
	size_t mcus;
	int ret;

	reader->mcus_x = (reader->width_px + 8 * h - 1) / (8 * h);
	reader->mcus_y = (reader->height_px + 8 * v - 1) / (8 * v);
	mcus = (size_t)reader->mcus_x * reader->mcus_y;
	for (int k = 0; k < reader->component_count; k++) {
		struct lp_jpeg_component *c = &reader->component[k];

		c->blocks_x = reader->mcus_x * c->h;
		c->blocks_y = reader->mcus_y * c->v;
		c->dc_step = reader->quant[c->quant_table][0];
		ret = reserve(&c->dc, &reader->block_capacity[k],
			      mcus * c->h * c->v + LP_JPEG_BLOCK_MARGIN, sizeof(*c->dc));
		if (ret < 0)
			return ret;
	}
	if (reader->block_capacity[0] != luma_before) {
		free(reader->energy);
		reader->energy = calloc(reader->block_capacity[0], sizeof(*reader->energy));
		if (!reader->energy) {
			reader->block_capacity[0] = 0;
			return -ENOMEM;
		}
	}
	return reserve(&reader->mcu_bit, &reader->mcu_capacity, mcus, sizeof(*reader->mcu_bit));
}

static int add_segment(struct lp_jpeg_reader *reader, size_t at)
{
	if (reader->segment_count + 2 > reader->segment_capacity) {
		const int capacity = 2 * reader->segment_capacity + 64;
		uint32_t *grown = realloc(reader->segment_start, capacity * sizeof(*grown));

		if (!grown)
			return -ENOMEM;
		reader->segment_start = grown;
		reader->segment_capacity = capacity;
	}
	reader->segment_start[reader->segment_count++] = (uint32_t)at;
	return 0;
}

/* Copy the entropy-coded data without its stuffing, a gap of zeros at each restart marker. */
static int unstuff(struct lp_jpeg_reader *reader, const uint8_t *data, size_t size)
{
	const uint8_t *from = data, *end = data + size;
	uint8_t *to;
	int ret;

	/* each restart marker (2 bytes) becomes a gap: at most four times the room */
	ret = reserve(&reader->stream, &reader->stream_capacity,
		      (reader->restart_interval ? SEGMENT_GAP_BYTES / 2 : 1) * size +
			      STREAM_PADDING_BYTES,
		      1);
	if (ret < 0)
		return ret;
	to = reader->stream;
	reader->segment_count = 0;
	ret = add_segment(reader, 0);
	while (ret == 0 && from < end) {
		const uint8_t *ff = memchr(from, 0xff, end - from);
		const size_t run = (ff ? ff : end) - from;

		memcpy(to, from, run);
		to += run;
		if (!ff || ff + 1 == end)
			break;
		from = ff + 2;
		if (ff[1] == 0) {
			*to++ = 0xff;
		} else if (ff[1] == 0xff) {
			from = ff + 1; /* fill byte */
		} else if (reader->restart_interval && ff[1] >= 0xd0 && ff[1] <= 0xd7) {
			/* markers count modulo 8: one out of turn means that data is missing */
			if (ff[1] != 0xd0 + (reader->segment_count - 1) % 8)
				return -EBADMSG;
			memset(to, 0, SEGMENT_GAP_BYTES);
			to += SEGMENT_GAP_BYTES;
			ret = add_segment(reader, to - reader->stream);
		} else {
			break; /* EOI, or what only another scan would need */
		}
	}
	memset(to, 0, STREAM_PADDING_BYTES);
	reader->stream_size = to - reader->stream;
	reader->segment_start[reader->segment_count] =
		(uint32_t)(reader->stream_size + SEGMENT_GAP_BYTES);
	return ret;
}

/* For what read_segment() consists of: bits in registers, and a version each for luma and chroma.
 */
#define HOT_INLINE static inline __attribute__((always_inline))

/* Bits of a stream, most significant first; `count` of them are in `window`, left-aligned. */
struct bits {
	const uint8_t *next;
	uint64_t window;
	int count;
};

/* At least 56 bits afterwards. Reads 8 bytes at `next` (the stream is padded). */
static inline void refill(struct bits *b)
{
	uint64_t word;

	memcpy(&word, b->next, sizeof(word));
	b->window |= __builtin_bswap64(word) >> b->count;
	b->next += (63 - b->count) >> 3;
	b->count |= 56;
}

static inline uint32_t peek(const struct bits *b, int n)
{
	return (uint32_t)(b->window >> (64 - n));
}

static inline void drop(struct bits *b, int n)
{
	b->window <<= n;
	b->count -= n;
}

static inline uint32_t position(const struct bits *b, const uint8_t *stream)
{
	return (uint32_t)((b->next - stream) * 8 - b->count);
}

static struct bits bits_at(const uint8_t *stream, uint32_t bit)
{
	struct bits b = {.next = stream + bit / 8};

	refill(&b);
	drop(&b, (int)(bit % 8));
	return b;
}

/* One symbol and its value bits, the slow way; needs 31 bits. -1: no such code. */
static __attribute__((noinline, cold)) int slow_symbol(struct bits *b,
						       const struct lp_huffman *code, int *value)
{
	int length, symbol = lp_huffman_slow(code, peek(b, 16), &length);

	if (symbol < 0)
		return -1;
	drop(b, length);
	*value = 0;
	if (symbol & 15) {
		*value = lp_jpeg_extend(peek(b, symbol & 15), symbol & 15);
		drop(b, symbol & 15);
	}
	return symbol;
}

/* One AC symbol whose code is longer than a probe, or that ends the block exactly. Returns the next
 * coefficient's index, 64 when the block is done, -1 when the data is broken. */
static __attribute__((noinline, cold)) int pass_slowly(struct bits *b,
						       const struct lp_huffman *code, int k,
						       const float *weight, float *energy)
{
	int value;

	refill(b);
	const int symbol = slow_symbol(b, code, &value);

	if (symbol < 0)
		return -1;
	if ((symbol & 15) == 0 && symbol >> 4 != 15)
		return 64;
	k += (symbol >> 4) + 1;
	if (k > 64)
		return -1;
	if (weight)
		*energy += (float)value * (float)value * weight[k - 1];
	return k;
}

/*
 * Pass a block's AC coefficients right after its head. With `weight` (squared quantisers, zigzag
 * order; luma) *energy receives the sum of the squared values. False: broken.
 *
 * The bits live in a local, and the slow path gets a copy of its own: were the local's address
 * taken, every probe would go through memory, and this loop is nothing but probes.
 */
HOT_INLINE bool pass_ac(struct bits *bits, const struct lp_huffman_ac *table, const float *weight,
			float *energy)
{
	const uint16_t *skips = table->skip;
	const uint32_t *energies = table->energy;
	struct bits b = *bits;
	float sum = 0.0F;
	int k = 1, probes = PROBES_AFTER_HEAD;

	/* as they are: an address that is put together anew for every probe costs it a cycle */
	__asm__("" : "+r"(skips), "+r"(energies));
	while (k < 64) {
		for (; probes > 0; probes--) {
			const uint32_t p = peek(&b, LP_PROBE_BITS);
			const uint32_t skip = skips[p];
			const int after = k + (int)lp_skip_advance(skip);

			if (__builtin_expect(after >= 64, 0) && !lp_skip_ends(after)) {
				struct bits copy = b;
				float more = 0.0F;

				k = pass_slowly(&copy, &table->code, k, weight, &more);
				b = copy;
				sum += more;
				break;
			}
			if (weight)
				sum += lp_probe_energy(energies[p]) *
				       weight[(k + lp_probe_strongest(energies[p])) & 63];
			drop(&b, lp_skip_bits(skip));
			k = after;
			if (k >= 64)
				break;
		}
		if (k < 0)
			return false;
		if (k >= 64)
			break;
		refill(&b);
		probes = PROBES_PER_REFILL;
	}
	if (energy)
		*energy = sum;
	*bits = b;
	return true;
}

/* DC of the block at `bits`. *whole: it has no more than that, and is passed. False: broken. */
HOT_INLINE bool read_head(const struct lp_jpeg_reader *reader, struct bits *bits,
			  const struct lp_jpeg_component *c, int *difference, bool *whole)
{
	struct bits b = *bits;

	refill(&b);
	const struct lp_dc_probe probe =
		reader->head[c->dc_table][c->ac_table][peek(&b, LP_HEAD_BITS)];

	*whole = probe.block_bits;
	*difference = probe.difference;
	if (__builtin_expect(probe.bits == 0, 0)) {
		struct bits copy = b; /* see pass_ac() */
		const bool sound =
			slow_symbol(&copy, &reader->dc_table[c->dc_table], difference) >= 0;

		refill(&copy);
		*bits = copy;
		return sound;
	}
	drop(&b, probe.block_bits ? probe.block_bits : probe.bits);
	*bits = b;
	return true;
}

HOT_INLINE bool read_block(struct lp_jpeg_reader *reader, struct bits *b,
			   struct lp_jpeg_component *c, bool luma, const float *weight,
			   size_t block)
{
	int difference;
	bool whole;

	if (!read_head(reader, b, c, &difference, &whole))
		return false;
	c->prediction = (int16_t)(c->prediction + difference);
	c->dc[block] = c->prediction;
	if (luma)
		reader->energy[block] = 0.0F;
	if (whole)
		return true;
	return luma ? pass_ac(b, &reader->ac_table[c->ac_table], weight, &reader->energy[block])
		    : pass_ac(b, &reader->ac_table[c->ac_table], NULL, NULL);
}

/* The MCUs of one restart segment; its bits must not run past its end. */
static int read_segment(struct lp_jpeg_reader *reader, int segment, int first_mcu, int last_mcu,
			const float *weight)
{
	const uint32_t end_bit = (reader->segment_start[segment + 1] - SEGMENT_GAP_BYTES) * 8;
	struct bits b = bits_at(reader->stream, reader->segment_start[segment] * 8);
	int x = first_mcu % reader->mcus_x, y = first_mcu / reader->mcus_x;

	for (int k = 0; k < reader->component_count; k++)
		reader->component[k].prediction = 0;
	for (int mcu = first_mcu; mcu < last_mcu; mcu++) {
		reader->mcu_bit[mcu] = position(&b, reader->stream);
		if (reader->mcu_bit[mcu] > end_bit)
			return -EBADMSG;
		for (int k = 0; k < reader->component_count; k++) {
			struct lp_jpeg_component *c = &reader->component[k];

			for (int v = 0; v < c->v; v++)
				for (int h = 0; h < c->h; h++)
					if (!read_block(reader, &b, c, k == 0, weight,
							(size_t)(y * c->v + v) * c->blocks_x +
								x * c->h + h))
						return -EBADMSG;
		}
		if (++x == reader->mcus_x) {
			x = 0;
			y++;
		}
	}
	return position(&b, reader->stream) > end_bit ? -EBADMSG : 0;
}

static int read_scan(struct lp_jpeg_reader *reader)
{
	const int mcus = reader->mcus_x * reader->mcus_y;
	const int interval = reader->restart_interval ? reader->restart_interval : mcus;
	const int segments = (mcus + interval - 1) / interval;
	const uint16_t *quant = reader->quant[reader->component[0].quant_table];
	float weight[64];

	if (reader->segment_count < segments)
		return -EBADMSG;
	for (int k = 0; k < 64; k++)
		weight[k] = (float)quant[k] * (float)quant[k];
	for (int s = 0; s < segments; s++) {
		const int first = s * interval;
		const int last = first + interval < mcus ? first + interval : mcus;
		int ret = read_segment(reader, s, first, last, weight);

		if (ret < 0)
			return ret;
	}
	return 0;
}

int lp_jpeg_read(struct lp_jpeg_reader *reader, const uint8_t *data, size_t size_bytes)
{
	long scan = lp_jpeg_parse_headers(reader, data, size_bytes);
	int ret = scan < 0 ? (int)scan : reserve_blocks(reader);

	if (ret == 0 && size_bytes - scan > UINT32_MAX / 64)
		ret = -ENOTSUP; /* bit offsets are kept in 32 bits */
	if (ret == 0)
		ret = unstuff(reader, data + scan, size_bytes - scan);
	if (ret == 0)
		ret = read_scan(reader);
	if (ret < 0)
		reader->width_px = reader->height_px = 0;
	return ret;
}

int lp_jpeg_visible_blocks_x(const struct lp_jpeg_reader *reader, int c)
{
	const int step = 8 * reader->component[0].h / reader->component[c].h;

	return (reader->width_px + step - 1) / step;
}

int lp_jpeg_visible_blocks_y(const struct lp_jpeg_reader *reader, int c)
{
	const int step = 8 * reader->component[0].v / reader->component[c].v;

	return (reader->height_px + step - 1) / step;
}

static const uint8_t natural_order[64] = {0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18,
					  11, 4,  5,  12, 19, 26, 33, 40, 48, 41, 34, 27, 20,
					  13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43,
					  36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45,
					  38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63};

/* A symbol and its value bits, by the probe's length table when the code is short; needs 31 bits.
 * The stream has been found sound by lp_jpeg_read(). */
static inline int sound_symbol(struct bits *b, const struct lp_huffman *code, int *value)
{
	const uint32_t probe = peek(b, LP_PROBE_BITS);

	if (!code->length_at[probe])
		return slow_symbol(b, code, value);
	const int symbol = code->symbol_at[probe];

	drop(b, code->length_at[probe]);
	*value = 0;
	if (symbol & 15) {
		*value = lp_jpeg_extend(peek(b, symbol & 15), symbol & 15);
		drop(b, symbol & 15);
	}
	return symbol;
}

/* All coefficients of the block at `b`, whose DC is known. */
static void decode_block(const struct lp_jpeg_reader *reader, struct bits *b,
			 const struct lp_jpeg_component *c, int16_t dc, int16_t *coefficients)
{
	const struct lp_huffman *code = &reader->ac_table[c->ac_table].code;
	const uint16_t *quant = reader->quant[c->quant_table];
	bool whole;
	int value;

	memset(coefficients, 0, 64 * sizeof(*coefficients));
	coefficients[0] = (int16_t)(dc * quant[0]);
	if (!read_head(reader, b, c, &value, &whole) || whole)
		return;
	for (int k = 1; k < 64; k++) {
		refill(b);
		const int symbol = sound_symbol(b, code, &value);

		if (symbol < 0 || ((symbol & 15) == 0 && symbol >> 4 != 15))
			return;
		k += symbol >> 4;
		if (k > 63)
			return;
		coefficients[natural_order[k]] = (int16_t)(value * quant[k]);
	}
}

/* Pass the block at `b`. */
static void skip_block(const struct lp_jpeg_reader *reader, struct bits *b,
		       const struct lp_jpeg_component *c)
{
	int difference;
	bool whole;

	if (read_head(reader, b, c, &difference, &whole) && !whole)
		pass_ac(b, &reader->ac_table[c->ac_table], NULL, NULL);
}

void lp_jpeg_block_coefficients(const struct lp_jpeg_reader *reader, int bx, int by,
				struct lp_jpeg_mcu_block *block)
{
	const struct lp_jpeg_component *luma = &reader->component[0];
	const int mcu_x = bx / luma->h, mcu_y = by / luma->v;
	const int mcu = mcu_y * reader->mcus_x + mcu_x;
	const int wanted = by % luma->v * luma->h + bx % luma->h;
	struct bits b = bits_at(reader->stream, reader->mcu_bit[mcu]);
	int16_t *chroma[2] = {block->cb, block->cr};

	for (int k = 0; k < luma->h * luma->v; k++) {
		if (k == wanted)
			decode_block(reader, &b, luma, luma->dc[(size_t)by * luma->blocks_x + bx],
				     block->luma);
		else if (k < wanted || reader->component_count > 1)
			skip_block(reader, &b, luma);
	}
	for (int k = 1; k < reader->component_count && k <= 2; k++)
		decode_block(reader, &b, &reader->component[k], reader->component[k].dc[mcu],
			     chroma[k - 1]);
}
