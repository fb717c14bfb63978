/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/jpeg/blocks.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define SEGMENT_GAP_BYTES 8
#define EOI 0xd9
/* A walk that is so far behind the end has left its stretch. */
#define WALK_BEYOND_BITS 64
/* A stretch of the stream that is worth two walks. */
#define WORTH_TWO_BITS (8 * 128)
/* A guess that breaks so near to the end has no more to find. */
#define GUESS_LEAST_BITS (8 * 64)
/* Cameras (Logitech C270, C910) leave bytes behind the last MCU before a restart marker or the
 * picture's end. More than these are another picture's, or stand where something is missing. Chosen
 * by hand (docs/maintainers/constants.md). */
#define MOST_EXTRANEOUS_BYTES 16
/* How far the first walk goes on before it looks again whether it has met the second. */
#define MEET_BITS (8 * 128)

int lp_jpeg_reader_create(struct lp_jpeg_reader **reader)
{
	*reader = calloc(1, sizeof(**reader));
	return *reader ? 0 : -ENOMEM;
}

void lp_jpeg_reader_destroy(struct lp_jpeg_reader *reader)
{
	if (!reader)
		return;
	for (int c = 0; c < 3; c++) {
		free(reader->component[c].dc);
		free(reader->component[c].quarters);
	}
	free(reader->energy);
	free(reader->stream);
	free(reader->segment_start);
	free(reader->mcu_bit);
	free(reader->marks);
	free(reader);
}

int lp_jpeg_reserve(void *storage, size_t *capacity, size_t count, size_t element_bytes)
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
		ret = lp_jpeg_reserve(&c->dc, &reader->block_capacity[k],
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
	return lp_jpeg_reserve(&reader->mcu_bit, &reader->mcu_capacity, mcus,
			       sizeof(*reader->mcu_bit));
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
	ret = lp_jpeg_reserve(&reader->stream, &reader->stream_capacity,
			      (reader->restart_interval ? SEGMENT_GAP_BYTES / 2 : 1) * size +
				      LP_JPEG_WALK_PADDING,
			      1);
	if (ret < 0)
		return ret;
	to = reader->stream;
	reader->segment_count = 0;
	reader->goes_on = false;
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
			reader->goes_on = ff[1] != EOI;
			break;
		}
	}
	memset(to, 0, LP_JPEG_WALK_PADDING);
	reader->stream_size = to - reader->stream;
	reader->segment_start[reader->segment_count] =
		(uint32_t)(reader->stream_size + SEGMENT_GAP_BYTES);
	return ret;
}

/* DC difference at `bit`. The block has been walked: its code is sound. */
static inline int dc_difference(const uint8_t *stream, uint32_t bit,
				const struct lp_huffman_dc *table)
{
	const uint64_t window = lp_jpeg_window(stream, bit);
	int length;

	const int difference = table->difference[window >> (64 - LP_PROBE_BITS)];

	if (__builtin_expect(difference != LP_DC_UNKNOWN, 1))
		return difference;

	const int size = lp_huffman_symbol(&table->code, (uint32_t)(window >> 48), &length);

	return size > 0 ? lp_jpeg_extend((uint32_t)(window << length >> (64 - size)), size) : 0;
}

/* Where the blocks of the MCUs in a row go, beginning with the first in the picture. */
struct mcu_row {
	int16_t *luma[4], *chroma[2]; /* DC */
	int32_t *energy[4];
};

static struct mcu_row row_at(struct lp_jpeg_reader *reader, int mcu_y)
{
	const struct lp_jpeg_component *luma = &reader->component[0];
	struct mcu_row row = {{NULL}, {NULL}, {NULL}};

	for (int b = 0; b < luma->h * luma->v; b++) {
		const size_t at =
			(size_t)(mcu_y * luma->v + b / luma->h) * luma->blocks_x + b % luma->h;

		row.luma[b] = luma->dc + at;
		row.energy[b] = reader->energy + at;
	}
	for (int k = 1; k < reader->component_count; k++)
		row.chroma[k - 1] = reader->component[k].dc + (size_t)mcu_y * reader->mcus_x;
	return row;
}

/* What has been walked through, of one row: its MCUs first .. last - 1, from `from` on. Returns the
 * last mark. */
static struct lp_jpeg_mark store_row(struct lp_jpeg_reader *reader, int mcu_y, int first, int last,
				     struct lp_jpeg_mark from, const struct lp_jpeg_mark *marks)
{
	const struct lp_jpeg_component *luma = &reader->component[0];
	const struct lp_huffman_dc *luma_table = &reader->dc_table[luma->dc_table];
	const int step = luma->h, lumas = luma->h * luma->v, chromas = reader->component_count - 1;
	const struct mcu_row row = row_at(reader, mcu_y);
	uint32_t *bit = reader->mcu_bit + (size_t)mcu_y * reader->mcus_x;
	uint32_t dc = reader->prediction[0]; /* modulo 2^16, as far as it counts */

	for (int x = first; x < last; x++) {
		bit[x] = from.end_bit;
		for (int b = 0; b < lumas; b++, from = *marks++) {
			dc += (uint32_t)dc_difference(reader->stream, from.end_bit, luma_table);
			row.luma[b][x * step] = (int16_t)dc;
			/* the highest bit is nonsense of a broken stream */
			row.energy[b][x * step] =
				(int32_t)((marks->energy - from.energy) & INT32_MAX);
		}
		for (int k = 0; k < chromas; k++, from = *marks++) {
			const struct lp_huffman_dc *table =
				&reader->dc_table[reader->component[k + 1].dc_table];

			reader->prediction[k + 1] +=
				(uint32_t)dc_difference(reader->stream, from.end_bit, table);
			row.chroma[k][x] = (int16_t)reader->prediction[k + 1];
		}
	}
	reader->prediction[0] = dc;
	return from;
}

/* Same for MCUs of the picture, row after row. Returns where they end. */
static uint32_t store(struct lp_jpeg_reader *reader, int first, int last, struct lp_jpeg_mark from,
		      const struct lp_jpeg_mark *marks)
{
	const int width = reader->mcus_x;

	while (first < last) {
		const int y = first / width, x = first % width;
		const int end = last - first < width - x ? x + last - first : width;

		from = store_row(reader, y, x, end, from, marks);
		marks += (size_t)(end - x) * reader->path.slots;
		first += end - x;
	}
	return from.end_bit;
}

static void forget_predictions(struct lp_jpeg_reader *reader)
{
	memset(reader->prediction, 0, sizeof(reader->prediction));
}

/* MCUs between two restart markers, or all of them. */
struct stretch {
	int first, last;
	uint32_t bit, end_bit; /* of the stream */
	uint32_t limit_bit;    /* a walk that is there has left it */
	struct lp_jpeg_mark *marks;
};

static struct stretch stretch_at(struct lp_jpeg_reader *reader, int segment, int interval,
				 struct lp_jpeg_mark *marks)
{
	const int mcus = reader->mcus_x * reader->mcus_y;
	const uint32_t end = reader->segment_start[segment + 1] - SEGMENT_GAP_BYTES;
	const int first = segment * interval;

	return (struct stretch){.first = first,
				.last = interval < mcus - first ? first + interval : mcus,
				.bit = 8 * reader->segment_start[segment],
				.end_bit = 8 * end,
				.limit_bit = 8 * end + WALK_BEYOND_BITS,
				.marks = marks};
}

static void begin(const struct lp_jpeg_reader *reader, const struct stretch *s,
		  struct lp_jpeg_walk *walk)
{
	lp_jpeg_walk_begin(walk, &reader->path, s->bit, s->limit_bit, s->marks,
			   (size_t)(s->last - s->first) * reader->path.slots);
}

/* Where the last MCU of a stretch ends, and its data. */
static int check_end(const struct stretch *s, uint32_t bit)
{
	return bit > s->end_bit || s->end_bit - bit >= 8 * (MOST_EXTRANEOUS_BYTES + 1) ? -EBADMSG
										       : 0;
}

/* What a walk has passed must be all of its stretch, and hardly more. */
static int finish(struct lp_jpeg_reader *reader, const struct stretch *s,
		  const struct lp_jpeg_walk *walk)
{
	if (!lp_jpeg_walk_is_whole(walk))
		return -EBADMSG;
	forget_predictions(reader);
	return check_end(s, store(reader, s->first, s->last, (struct lp_jpeg_mark){s->bit, 0},
				  s->marks));
}

/* Two restart segments in turns, or one. */
static int read_stretches(struct lp_jpeg_reader *reader, const struct stretch *s, int count)
{
	struct lp_jpeg_walk walk[2];
	int ret = 0;

	for (int k = 0; k < count; k++)
		begin(reader, &s[k], &walk[k]);
	if (count == 2)
		lp_jpeg_walk_both(&walk[0], &walk[1], &reader->path);
	for (int k = 0; k < count && ret == 0; k++) {
		lp_jpeg_walk_on(&walk[k], &reader->path);
		ret = finish(reader, &s[k], &walk[k]);
	}
	return ret;
}

/*
 * A stretch without restart markers in two walks. The second one begins in the middle, at a place
 * that is no block's beginning, and knows neither which MCU it is in nor where: Huffman codes
 * synchronise themselves (Ferguson & Rabinowitz 1984, "Self-synchronizing Huffman codes"; for JPEG:
 * Klein & Wiseman 2003, "Parallel Huffman decoding with applications to JPEG files"). After some
 * blocks of nonsense it goes where the first one will come, and from the MCU on whose end both
 * agree its marks are true. Until then nothing of it counts.
 */
struct guess {
	struct lp_jpeg_walk walk;
	struct lp_jpeg_mark *marks;
};

static void begin_guess(const struct lp_jpeg_reader *reader, const struct stretch *s,
			struct guess *g, uint32_t bit)
{
	lp_jpeg_walk_begin(&g->walk, &reader->path, bit, s->limit_bit, g->marks,
			   (size_t)(s->last - s->first) * reader->path.slots);
}

/* A guess that came upon no code begins anew behind it; at the end it has no more to find. */
static bool guess_again(const struct lp_jpeg_reader *reader, const struct stretch *s,
			struct guess *g)
{
	const uint32_t bit = (g->walk.bit & ~7U) + 8;

	if (!g->walk.broken_at || bit + GUESS_LEAST_BITS > s->end_bit)
		return false;
	begin_guess(reader, s, g, bit);
	return true;
}

/* The MCU on whose end the walk and the guess agree, by how many MCUs each has passed until there.
 */
static bool meet(const struct lp_jpeg_walk *walk, const struct stretch *s, const struct guess *g,
		 int slots, int passed[2])
{
	const int walked = (int)((walk->mark - s->marks) / slots);
	const int count = walked < s->last - s->first ? walked : s->last - s->first;
	const struct lp_jpeg_mark *sound = g->walk.broken_at ? g->walk.broken_at : g->walk.mark;
	const int guessed = (int)((sound - g->marks) / slots);

	while (passed[0] < count && passed[1] < guessed) {
		const uint32_t end = s->marks[(passed[0] + 1) * slots - 1].end_bit;
		const uint32_t guess_end = g->marks[(passed[1] + 1) * slots - 1].end_bit;

		passed[0] += end <= guess_end;
		passed[1] += guess_end <= end;
		if (end == guess_end) /* with more nonsense than truth its marks have no room */
			return passed[1] <= passed[0];
	}
	return false;
}

static int read_in_two(struct lp_jpeg_reader *reader, const struct stretch *s,
		       struct lp_jpeg_mark *marks)
{
	const struct lp_jpeg_path *path = &reader->path;
	const uint32_t middle = s->bit / 2 + s->end_bit / 2;
	struct lp_jpeg_walk walk;
	struct guess guess = {.marks = marks};
	int passed[2] = {0, 0};

	begin(reader, s, &walk);
	walk.limit_bit = middle;
	begin_guess(reader, s, &guess, middle);
	do
		lp_jpeg_walk_both(&walk, &guess.walk, path);
	while (!lp_jpeg_walk_ended(&walk) && guess_again(reader, s, &guess));
	for (;;) {
		lp_jpeg_walk_on(&walk, path);
		if (lp_jpeg_walk_failed(&walk))
			return -EBADMSG;
		if (meet(&walk, s, &guess, path->slots, passed))
			break;
		if (walk.limit_bit >= s->limit_bit) /* never met: one walk it is */
			return finish(reader, s, &walk);
		walk.limit_bit = walk.limit_bit + MEET_BITS < s->limit_bit
					 ? walk.limit_bit + MEET_BITS
					 : s->limit_bit;
	}

	const int met = s->first + passed[0];

	guess.walk.last = marks + (size_t)(passed[1] + s->last - met) * path->slots;
	lp_jpeg_walk_on(&guess.walk, path);
	if (!lp_jpeg_walk_is_whole(&guess.walk))
		return -EBADMSG;
	forget_predictions(reader);

	store(reader, s->first, met, (struct lp_jpeg_mark){s->bit, 0}, s->marks);
	marks += (size_t)passed[1] * path->slots;
	return check_end(s, store(reader, met, s->last, marks[-1], marks));
}

static void prepare_path(struct lp_jpeg_reader *reader)
{
	const uint16_t *quant = reader->quant[reader->component[0].quant_table];
	struct lp_jpeg_path *path = &reader->path;
	const struct lp_probes *head[LP_JPEG_SLOTS] = {NULL};

	path->slots = 0;
	for (int k = 0; k < reader->component_count; k++) {
		const struct lp_jpeg_component *c = &reader->component[k];
		const struct lp_huffman_ac *ac = &reader->ac_table[c->ac_table];

		for (int b = 0; b < c->h * c->v; b++) {
			head[path->slots] = &reader->head[c->dc_table][c->ac_table];
			path->slot[path->slots++] =
				(struct lp_jpeg_slot){.inside = &ac->probes,
						      .dc_code =
							      &reader->dc_table[c->dc_table].code,
						      .ac_code = &ac->code};
		}
	}
	for (int k = 0; k < path->slots; k++) {
		struct lp_jpeg_slot *slot = &path->slot[k];
		const int next = (k + 1) % path->slots;

		slot->next[0] = slot;
		slot->next[1] = &path->slot[next];
		slot->to_head = (const char *)head[next] - (const char *)slot->inside;
	}
	path->stream = reader->stream;
	for (int k = 1; k < 64; k++)
		path->weight[k] = (uint32_t)quant[k] * quant[k];
}

static int read_scan(struct lp_jpeg_reader *reader)
{
	const int mcus = reader->mcus_x * reader->mcus_y;
	const int interval = reader->restart_interval && reader->restart_interval < mcus
				     ? reader->restart_interval
				     : mcus;
	const int segments = (mcus + interval - 1) / interval;
	int ret = 0;

	prepare_path(reader);

	const size_t room = (size_t)interval * reader->path.slots + LP_JPEG_WALK_MARGIN;

	if (reader->segment_count < segments)
		return -EBADMSG;
	ret = lp_jpeg_reserve(&reader->marks, &reader->mark_capacity, 2 * room,
			      sizeof(*reader->marks));
	for (int s = 0; ret == 0 && s < segments; s += 2) {
		const int count = s + 1 < segments ? 2 : 1;
		struct stretch stretch[2];

		for (int k = 0; k < count; k++)
			stretch[k] = stretch_at(reader, s + k, interval, reader->marks + k * room);
		if (count == 1 && stretch[0].end_bit - stretch[0].bit > WORTH_TWO_BITS)
			ret = read_in_two(reader, stretch, reader->marks + room);
		else
			ret = read_stretches(reader, stretch, count);
	}
	return ret;
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
	if (ret == 0 && reader->goes_on)
		ret = -ENOTSUP;
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
