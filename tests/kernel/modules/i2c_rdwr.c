// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * An I2C bus with register-file chips on it that takes raw transfers (I2C_RDWR), which i2c-stub does
 * not. Each chip has 256 registers and a pointer: the first byte of a write sets the pointer, further
 * bytes are stored, reads start at the pointer.
 *
 *	insmod i2c_rdwr.ko chips=0x40,0x68
 *
 * Parameters that may be changed at run time, to misbehave:
 *	nack=ADDR	this chip does not answer (-1: all do)
 *	lost=N		the bus fails N more transfers with -EAGAIN (arbitration lost)
 */
#include <linux/i2c.h>
#include <linux/module.h>

#define MAX_CHIPS 8

struct chip {
	u8 registers[256];
	u8 pointer;
};

static ushort chips[MAX_CHIPS];
static int chip_count;
module_param_array(chips, ushort, &chip_count, 0444);
static int nack = -1;
module_param(nack, int, 0644);
static int lost;
module_param(lost, int, 0644);

static struct chip files[MAX_CHIPS];

static struct chip *find_chip(u16 address)
{
	int i;

	if (address == nack)
		return NULL;
	for (i = 0; i < chip_count; i++)
		if (chips[i] == address)
			return &files[i];
	return NULL;
}

static void transfer_message(struct chip *chip, struct i2c_msg *message)
{
	int i;

	if (message->flags & I2C_M_RD) {
		for (i = 0; i < message->len; i++)
			message->buf[i] = chip->registers[chip->pointer++];
		return;
	}
	if (message->len)
		chip->pointer = message->buf[0];
	for (i = 1; i < message->len; i++)
		chip->registers[chip->pointer++] = message->buf[i];
}

static int transfer(struct i2c_adapter *adapter, struct i2c_msg *messages, int count)
{
	int i;

	if (lost > 0) {
		lost--;
		return -EAGAIN;
	}
	for (i = 0; i < count; i++) {
		struct chip *chip = find_chip(messages[i].addr);

		if (!chip)
			return -ENXIO;
		transfer_message(chip, &messages[i]);
	}
	return count;
}

static u32 functionality(struct i2c_adapter *adapter)
{
	return I2C_FUNC_I2C | I2C_FUNC_SMBUS_EMUL;
}

static const struct i2c_algorithm algorithm = {
	.master_xfer = transfer,
	.functionality = functionality,
};

static struct i2c_adapter adapter = {
	.owner = THIS_MODULE,
	.name = "lightprobe register files",
	.algo = &algorithm,
};

static int __init i2c_rdwr_init(void)
{
	return i2c_add_adapter(&adapter);
}

static void __exit i2c_rdwr_exit(void)
{
	i2c_del_adapter(&adapter);
}

module_init(i2c_rdwr_init);
module_exit(i2c_rdwr_exit);
MODULE_DESCRIPTION("I2C bus of register files for lightprobe's tests");
MODULE_LICENSE("GPL");
