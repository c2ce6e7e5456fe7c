/*
 * Copyright 2026 piezo_ros maintainers
 *
 * Licensed under the Apache License, Version 2.0 (the "License");
 * you may not use this file except in compliance with the License.
 * You may obtain a copy of the License at
 *
 *     http://www.apache.org/licenses/LICENSE-2.0
 *
 * Unless required by applicable law or agreed to in writing, software
 * distributed under the License is distributed on an "AS IS" BASIS,
 * WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
 * See the License for the specific language governing permissions and
 * limitations under the License.
 *
 * A network that loses datagrams, for LD_PRELOAD: of those that a process sends every
 * LOSE_ONE_OF-th goes nowhere, and one byte into the file LOST_DATAGRAMS.
 */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

static atomic_ulong sent;

static int is_lost(int socket)
{
  int type = 0;
  socklen_t size = sizeof type;
  const char * one_of = getenv("LOSE_ONE_OF");
  const char * file = getenv("LOST_DATAGRAMS");
  if (!one_of || !file || getsockopt(socket, SOL_SOCKET, SO_TYPE, &type, &size) != 0) {
    return 0;
  }
  if (type != SOCK_DGRAM || (atomic_fetch_add(&sent, 1) + 1) % strtoul(one_of, NULL, 10) != 0) {
    return 0;
  }
  int log = open(file, O_WRONLY | O_APPEND | O_CREAT, 0600);
  if (log >= 0) {
    if (write(log, "x", 1) < 0) {
      abort();
    }
    close(log);
  }
  return 1;
}

ssize_t sendmsg(int socket, const struct msghdr * message, int flags)
{
  static ssize_t (* send_it)(int, const struct msghdr *, int);
  if (is_lost(socket)) {
    ssize_t size = 0;
    for (size_t part = 0; part < message->msg_iovlen; part++) {
      size += (ssize_t)message->msg_iov[part].iov_len;
    }
    return size;
  }
  if (!send_it) {
    send_it = (ssize_t (*)(int, const struct msghdr *, int))dlsym(RTLD_NEXT, "sendmsg");
  }
  return send_it(socket, message, flags);
}

ssize_t sendto(
  int socket, const void * data, size_t size, int flags, const struct sockaddr * to, socklen_t length)
{
  static ssize_t (* send_it)(
    int, const void *, size_t, int, const struct sockaddr *, socklen_t);
  if (is_lost(socket)) {
    return (ssize_t)size;
  }
  if (!send_it) {
    send_it = (ssize_t (*)(
        int, const void *, size_t, int, const struct sockaddr *, socklen_t))
      dlsym(RTLD_NEXT, "sendto");
  }
  return send_it(socket, data, size, flags, to, length);
}
