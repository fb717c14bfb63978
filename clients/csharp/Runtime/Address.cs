// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using System.Globalization;
using System.Linq;

namespace Lightprobe
{
    /// <summary>
    /// tcp:HOST:PORT, ws://HOST:PORT/, or wss://HOST:PORT/#token=…&amp;sha256=… as `lightprobe pair` prints it, with https: for
    /// wss:. What follows # stays here: it is no part of what is asked for, and not in messages.
    /// </summary>
    internal sealed class Address
    {
        private static readonly Dictionary<string, int> Ports = new Dictionary<string, int> { { "ws", 80 }, { "wss", 443 } };

        internal readonly string Scheme; // tcp, ws or wss
        internal readonly string Host;
        internal readonly int Port;
        internal readonly string Token;  // null: none
        internal readonly byte[] Sha256; // of the certificate; null: a public authority vouches for it

        private Address(string scheme, string host, int port, string token = null, byte[] sha256 = null)
        {
            if (host == "0.0.0.0" || host == "::")
                throw new ArgumentException(scheme + ":" + host + ": address: it stands for all addresses of the probe's machine: "
                    + "take one of them, or its name");
            Scheme = scheme;
            Host = host;
            Port = port;
            Token = token;
            Sha256 = sha256;
        }

        public override string ToString()
        {
            string place = (Host.Contains(":") ? "[" + Host + "]" : Host) + ":" + Port;
            return Scheme == "tcp" ? "tcp:" + place : Scheme + "://" + place + "/";
        }

        internal Connection Open(int timeoutMs) =>
            Scheme == "tcp" ? (Connection)new TcpConnection(this, timeoutMs) : new WebConnection(this, timeoutMs);

        /// <exception cref="ArgumentException">It is no address.</exception>
        internal static Address Parse(string text)
        {
            if (text.StartsWith("tcp:", StringComparison.Ordinal)) return ParseTcp(text);
            // ws:HOST:PORT, as the daemon prints it, is ws://HOST:PORT/.
            foreach (string scheme in Ports.Keys)
                if (text.StartsWith(scheme + ":", StringComparison.Ordinal) && !text.StartsWith(scheme + "://", StringComparison.Ordinal))
                    text = scheme + "://" + text.Substring(scheme.Length + 1);
            if (Uri.TryCreate(text, UriKind.Absolute, out Uri uri) && uri.Host.Length > 0)
            {
                string scheme = uri.Scheme.Replace("http", "ws");
                if (Ports.ContainsKey(scheme)) return ParseWeb(uri, scheme);
            }
            if (text.StartsWith("mqtt:", StringComparison.Ordinal) || text.StartsWith("mqtts:", StringComparison.Ordinal))
                throw new ArgumentException(text.Split(':')[0] + ": address: this client speaks to the probe and to no MQTT broker: take the "
                    + "probe's own address, tcp:HOST:PORT or ws://HOST:PORT/ (lightprobed --publish), or Python's client");
            throw new ArgumentException(Shown(text) + ": address: expected tcp:HOST:PORT, ws://HOST:PORT/, or what `lightprobe pair` prints");
        }

        private static Address ParseTcp(string text)
        {
            int colon = text.LastIndexOf(':');
            string host = colon > 4 ? text.Substring(4, colon - 4) : "";
            if (host.StartsWith("[", StringComparison.Ordinal) && host.EndsWith("]", StringComparison.Ordinal))
                host = host.Substring(1, host.Length - 2);
            if (host.Length == 0 || !int.TryParse(text.Substring(colon + 1), NumberStyles.None, CultureInfo.InvariantCulture, out int port)
                || port < 1 || port > 65535)
                throw new ArgumentException(text + ": address: expected tcp:HOST:PORT, as tcp:127.0.0.1:7700");
            return new Address("tcp", host, port);
        }

        private static Address ParseWeb(Uri uri, string scheme)
        {
            Dictionary<string, string> extra = uri.Fragment.TrimStart('#').Split('&').Select(one => one.Split(new[] { '=' }, 2))
                .Where(pair => pair.Length == 2).GroupBy(pair => pair[0]).ToDictionary(pairs => pairs.Key, pairs => pairs.First()[1]);
            extra.TryGetValue("token", out string token);
            extra.TryGetValue("sha256", out string digits);
            if (!string.IsNullOrEmpty(token) && scheme != "wss")
                throw new ArgumentException(Shown(uri.OriginalString) + ": address: " + uri.Scheme
                    + ": would send the token in clear: take the address that `lightprobe pair` prints, with https: or wss:");
            int port = uri.IsDefaultPort || uri.Port < 0 ? Ports[scheme] : uri.Port;
            return new Address(scheme, uri.Host.Trim('[', ']'), port, token, digits == null ? null : Fingerprint(uri, digits));
        }

        private static byte[] Fingerprint(Uri uri, string text)
        {
            string digits = Uri.UnescapeDataString(text).Replace(":", "");
            var bytes = new byte[32];
            if (digits.Length == 64 && digits.All(Uri.IsHexDigit))
            {
                for (int i = 0; i < 32; i++) bytes[i] = Convert.ToByte(digits.Substring(2 * i, 2), 16);
                return bytes;
            }
            throw new ArgumentException(Shown(uri.OriginalString) + ": address: sha256= is not a fingerprint of 64 hexadecimal digits");
        }

        private static string Shown(string text) => text.Split('#')[0];
    }
}
