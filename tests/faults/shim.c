// Makes the n-th system call on files below one folder fail, or sends the process a signal there. Loaded with
// LD_PRELOAD, so that calls of Python and of OpenEXR are seen alike. Armed from inside, by fault_arm().
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>

enum { COUNT, FAIL_ONCE, FAIL_FROM_THEN_ON };  // below nought: the number of a signal, negative

static char folder[PATH_MAX];
static long at, calls;
static int action, code;

void fault_arm(const char* where, long n, int what, int error)
{
    strncpy(folder, where, sizeof folder - 1);
    at = n, action = what, code = error;
    __atomic_store_n(&calls, 0, __ATOMIC_SEQ_CST);
}

long fault_calls(void) { return __atomic_load_n(&calls, __ATOMIC_SEQ_CST); }

// True where the call on `path` is to fail; errno is set then.
static int fails(const char* path)
{
    if (!folder[0] || !path || strncmp(path, folder, strlen(folder)) != 0)
        return 0;
    const long n = __atomic_add_fetch(&calls, 1, __ATOMIC_SEQ_CST);
    if (action == COUNT || n < at || (n > at && action != FAIL_FROM_THEN_ON))
        return 0;
    if (action < 0) {
        kill(getpid(), -action);
        return 0;
    }
    errno = code;
    return 1;
}

static int fails_on(int descriptor)
{
    char link[64], path[PATH_MAX];
    if (!folder[0])
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    const ssize_t length = readlink(link, path, sizeof path - 1);
    path[length > 0 ? length : 0] = 0;
    return fails(path);
}

#define REAL(type, name, ...) ((type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name))

#define OPEN(name)                                                                                                     \
    int name(const char* path, int flags, ...)                                                                         \
    {                                                                                                                  \
        va_list rest;                                                                                                  \
        va_start(rest, flags);                                                                                         \
        const int mode = va_arg(rest, int);                                                                            \
        va_end(rest);                                                                                                  \
        return fails(path) ? -1 : REAL(int, name, const char*, int, int)(path, flags, mode);                           \
    }
OPEN(open)
OPEN(open64)

FILE* fopen64(const char* path, const char* mode)
{
    return fails(path) ? NULL : REAL(FILE*, fopen64, const char*, const char*)(path, mode);
}

ssize_t write(int to, const void* data, size_t size)
{
    return fails_on(to) ? -1 : REAL(ssize_t, write, int, const void*, size_t)(to, data, size);
}

ssize_t writev(int to, const struct iovec* parts, int count)
{
    return fails_on(to) ? -1 : REAL(ssize_t, writev, int, const struct iovec*, int)(to, parts, count);
}

ssize_t pwrite64(int to, const void* data, size_t size, off_t where)
{
    return fails_on(to) ? -1 : REAL(ssize_t, pwrite64, int, const void*, size_t, off_t)(to, data, size, where);
}

int fsync(int descriptor) { return fails_on(descriptor) ? -1 : REAL(int, fsync, int)(descriptor); }

int rename(const char* from, const char* to)
{
    return fails(to) ? -1 : REAL(int, rename, const char*, const char*)(from, to);
}
