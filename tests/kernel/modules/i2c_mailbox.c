// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * An I2C bus with one slave on it whose mailbox (proto/mcu.md) is served by a program, through
 * /dev/i2c_mailbox: each read gives one write transaction of the master, each write is one mail
 *that the master's next read takes. Without a mail the master reads length 0.
 *
 *	insmod i2c_mailbox.ko address=0x2c
 *
 * Parameters that may be changed at run time, to misbehave:
 *	nack=1		the slave does not answer
 *	error=N		every transfer fails with this errno (110: the clock is held)
 */
#include <linux/i2c.h>
#include <linux/kfifo.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/poll.h>
#include <linux/uaccess.h>
#include <linux/wait.h>

#define MAIL_BYTES 13

struct mail {
	u8 length;
	u8 bytes[MAIL_BYTES];
};

static ushort address = 0x2c;
module_param(address, ushort, 0444);
static int nack;
module_param(nack, int, 0644);
static int error;
module_param(error, int, 0644);

static DEFINE_KFIFO(to_master, struct mail, 256);
static DEFINE_KFIFO(from_master, struct mail, 256);
static DECLARE_WAIT_QUEUE_HEAD(waiting);

static void read_mail(struct i2c_msg *message)
{
	struct mail mail;

	memset(message->buf, 0xff, message->len);
	message->buf[0] = 0;
	if (message->len == MAIL_BYTES && kfifo_get(&to_master, &mail))
		memcpy(message->buf, mail.bytes, mail.length);
}

static void write_mail(const struct i2c_msg *message)
{
	struct mail mail = {.length = min_t(u16, message->len, MAIL_BYTES)};

	memcpy(mail.bytes, message->buf, mail.length);
	kfifo_put(&from_master, mail);
	wake_up_interruptible(&waiting);
}

static int transfer(struct i2c_adapter *adapter, struct i2c_msg *messages, int count)
{
	int i;

	if (error)
		return -error;
	for (i = 0; i < count; i++) {
		if (nack || messages[i].addr != address)
			return -ENXIO;
		if (messages[i].flags & I2C_M_RD)
			read_mail(&messages[i]);
		else
			write_mail(&messages[i]);
	}
	return count;
}

static u32 functionality(struct i2c_adapter *adapter)
{
	return I2C_FUNC_I2C;
}

static const struct i2c_algorithm algorithm = {
	.master_xfer = transfer,
	.functionality = functionality,
};

static struct i2c_adapter adapter = {
	.owner = THIS_MODULE,
	.name = "lightprobe mailbox",
	.algo = &algorithm,
};

static ssize_t slave_read(struct file *file, char __user *to, size_t size, loff_t *at)
{
	struct mail mail;

	if (wait_event_interruptible(waiting, !kfifo_is_empty(&from_master)))
		return -EINTR;
	if (!kfifo_get(&from_master, &mail) || size < mail.length)
		return -EINVAL;
	return copy_to_user(to, mail.bytes, mail.length) ? -EFAULT : mail.length;
}

static ssize_t slave_write(struct file *file, const char __user *from, size_t size, loff_t *at)
{
	struct mail mail = {.length = size};

	if (size > MAIL_BYTES)
		return -EINVAL;
	if (copy_from_user(mail.bytes, from, size))
		return -EFAULT;
	return kfifo_put(&to_master, mail) ? size : -ENOSPC;
}

static __poll_t slave_poll(struct file *file, poll_table *table)
{
	poll_wait(file, &waiting, table);
	return EPOLLOUT | (kfifo_is_empty(&from_master) ? 0 : EPOLLIN);
}

static const struct file_operations slave_operations = {
	.owner = THIS_MODULE,
	.read = slave_read,
	.write = slave_write,
	.poll = slave_poll,
};

static struct miscdevice slave = {
	.minor = MISC_DYNAMIC_MINOR,
	.name = "i2c_mailbox",
	.fops = &slave_operations,
};

static int __init i2c_mailbox_init(void)
{
	int ret = misc_register(&slave);

	if (ret)
		return ret;
	ret = i2c_add_adapter(&adapter);
	if (ret)
		misc_deregister(&slave);
	return ret;
}

static void __exit i2c_mailbox_exit(void)
{
	i2c_del_adapter(&adapter);
	misc_deregister(&slave);
}

module_init(i2c_mailbox_init);
module_exit(i2c_mailbox_exit);
MODULE_DESCRIPTION("I2C mailbox served by a program, for lightprobe's tests");
MODULE_LICENSE("GPL");
