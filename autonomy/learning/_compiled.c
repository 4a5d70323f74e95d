/* What plain.py does with scipy, without the cost of its calls: the three functions that every reading pays for.
 *
 * Optional: without a compiler at the time of installation plain.py is used. Plain C on the buffer protocol and Python's
 * stable interface: one build serves all versions of Python, and nothing is linked but libm.
 *
 * All matrices are float64 in column order. A state is (D + 1, D): S, and below it, as the last row, mu.
 */
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <math.h>
#include <string.h>

/* Where the loader can choose between them, the loops exist for processors with and without AVX2. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__GLIBC__)
#define FAST __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define FAST
#endif

/* ---- arithmetic ------------------------------------------------------------------------------------------------ */

/* x <- L^-1 x */
FAST static void solve(Py_ssize_t n, const double *L, double *x)
{
    for (Py_ssize_t j = 0; j < n; j++) {
        x[j] /= L[j + j * n];
        const double w = -x[j], *restrict column = L + j * n;
        double *restrict rest = x;
        for (Py_ssize_t i = j + 1; i < n; i++)
            rest[i] += w * column[i];
    }
}

/* M <- M - p p^T, columns of p only, for M (rows, columns) */
FAST static void downdate(Py_ssize_t rows, Py_ssize_t columns, double *M, const double *restrict p)
{
    for (Py_ssize_t j = 0; j < columns; j++) {
        double *restrict column = M + j * rows;
        const double w = p[j];
        for (Py_ssize_t i = 0; i < rows; i++)
            column[i] -= w * p[i];
    }
}

/* (a, b) <- (c a + s b, c b - s a) */
FAST static void rotate(Py_ssize_t n, double c, double s, double *restrict a, double *restrict b)
{
    for (Py_ssize_t i = 0; i < n; i++) {
        const double first = a[i], second = b[i];
        a[i] = c * first + s * second;
        b[i] = c * second - s * first;
    }
}

/* Make L (n, n) without its row `index` lower triangular again by rotating columns j and j + 1, whose cosines and sines
 * are written to cs. The rows behind move up; the last row and column become those of the spare coordinate. */
static void remove_row(Py_ssize_t n, double *L, Py_ssize_t index, double *cs)
{
    for (Py_ssize_t j = index; j < n - 1; j++) {
        double *a = L + j * n, *b = a + n;
        const double radius = hypot(a[j + 1], b[j + 1]), c = a[j + 1] / radius, s = b[j + 1] / radius;
        cs[2 * j] = c, cs[2 * j + 1] = s;
        rotate(n - 1 - j, c, s, a + j + 1, b + j + 1);
    }
    for (Py_ssize_t j = 0; j < n - 1; j++) {
        double *column = L + j * n;
        memmove(column + index, column + index + 1, (n - 1 - index) * sizeof(double));
        column[n - 1] = 0.0;
        if (j >= index)
            memset(column + index, 0, (j - index) * sizeof(double));
    }
    memset(L + (n - 1) * n, 0, n * sizeof(double));
    L[n * n - 1] = 1.0;
}

/* ---- arguments ------------------------------------------------------------------------------------------------- */

/* A buffer of float64 in column order with these dimensions (-1: any); 0 on success. */
static int take(PyObject *object, Py_buffer *view, const char *name, int dimensions, int writable)
{
    if (PyObject_GetBuffer(object, view, PyBUF_F_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)))
        return -1;
    if (view->ndim == dimensions && view->itemsize == sizeof(double) && strcmp(view->format, "d") == 0)
        return 0;
    PyBuffer_Release(view);
    PyErr_Format(PyExc_ValueError, "%s must be a float64 array of %d dimensions in column order", name, dimensions);
    return -1;
}

static int wrong(const char *what)
{
    PyErr_SetString(PyExc_ValueError, what);
    return -1;
}

#define ROWS(view) ((view).shape[0])
#define COLUMNS(view) ((view).shape[1])
#define DATA(view) ((double *)(view).buf)

/* ---- functions ------------------------------------------------------------------------------------------------- */

static PyObject *whiten(PyObject *self, PyObject *args)
{
    PyObject *first, *second;
    Py_buffer L, x;
    if (!PyArg_ParseTuple(args, "OO", &first, &second) || take(first, &L, "factor", 2, 0))
        return NULL;
    if (take(second, &x, "k", 1, 1)) {
        PyBuffer_Release(&L);
        return NULL;
    }
    int bad = ROWS(L) != COLUMNS(L) || ROWS(L) != ROWS(x) ? wrong("factor (n, n) and k (n,) do not fit") : 0;
    if (!bad)
        solve(ROWS(x), DATA(L), DATA(x));
    PyBuffer_Release(&L);
    PyBuffer_Release(&x);
    if (bad)
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *condition(PyObject *self, PyObject *args)
{
    PyObject *first, *second;
    double innovation, variance;
    Py_buffer state, p;
    if (!PyArg_ParseTuple(args, "OOdd", &first, &second, &innovation, &variance) || take(first, &state, "state", 2, 1))
        return NULL;
    if (take(second, &p, "p", 1, 1)) {
        PyBuffer_Release(&state);
        return NULL;
    }
    const Py_ssize_t rows = ROWS(state), columns = COLUMNS(state);
    int bad = rows != columns + 1 || ROWS(p) != rows ? wrong("state (D + 1, D) and p (D + 1,) do not fit") : 0;
    if (!bad) {
        double *w = DATA(p);
        const double scale = 1.0 / sqrt(variance);
        for (Py_ssize_t i = 0; i < columns; i++)
            w[i] *= scale;
        w[columns] = -innovation * scale;
        downdate(rows, columns, DATA(state), w);
    }
    PyBuffer_Release(&state);
    PyBuffer_Release(&p);
    if (bad)
        return NULL;
    Py_RETURN_NONE;
}

/* One pass of the removal: rotate the columns of every block of M (rows, D) as its group's factor asks. */
static void rotate_blocks(Py_ssize_t rows, Py_ssize_t used, double *M, Py_ssize_t n, Py_ssize_t blocks,
                          const Py_ssize_t *groups, Py_ssize_t index, const double *cs)
{
    for (Py_ssize_t b = 0; b < blocks; b++) {
        double *block = M + b * n * rows;
        const double *turn = cs + groups[b] * 2 * n;
        for (Py_ssize_t j = index; j < n - 1; j++)
            rotate(used, turn[2 * j], turn[2 * j + 1], block + j * rows, block + (j + 1) * rows);
    }
}

static void marginalise(Py_ssize_t D, Py_ssize_t n, double *state, double *other, const Py_ssize_t *groups,
                        Py_ssize_t index, const double *cs)
{
    const Py_ssize_t rows = D + 1, blocks = D / n;
    rotate_blocks(rows, rows, state, n, blocks, groups, index, cs);
    for (Py_ssize_t j0 = 0; j0 < D; j0 += 16)
        for (Py_ssize_t i = 0; i < D; i++)
            for (Py_ssize_t j = j0; j < j0 + 16 && j < D; j++)
                other[j + i * rows] = state[i + j * rows];
    rotate_blocks(rows, D, other, n, blocks, groups, index, cs);
    for (Py_ssize_t j = 0; j < D; j++)
        other[D + j * rows] = state[D + j * rows];
    for (Py_ssize_t spare = n - 1; spare < D; spare += n) {
        memset(other + spare * rows, 0, rows * sizeof(double));
        for (Py_ssize_t j = 0; j < D; j++)
            other[spare + j * rows] = 0.0;
        other[spare + spare * rows] = 1.0;
    }
}

/* The group of every block; 0 on success. */
static int read_groups(PyObject *blocks, Py_ssize_t count, Py_ssize_t many, Py_ssize_t *groups)
{
    for (Py_ssize_t b = 0; b < count; b++) {
        PyObject *item = PySequence_GetItem(blocks, b);
        groups[b] = item ? PyLong_AsSsize_t(item) : -1;
        Py_XDECREF(item);
        if (PyErr_Occurred())
            return -1;
        if (groups[b] < 0 || groups[b] >= many)
            return wrong("blocks name a group that has no factor");
    }
    return 0;
}

/* Remove row `index` from every factor (n, n) and note the rotations; 0 on success. */
static int remove_rows(PyObject *factors, Py_ssize_t many, Py_ssize_t n, Py_ssize_t index, double *cs)
{
    for (Py_ssize_t g = 0; g < many; g++) {
        Py_buffer factor;
        PyObject *item = PySequence_GetItem(factors, g);
        int bad = !item || take(item, &factor, "factor", 2, 1);
        Py_XDECREF(item);
        if (bad)
            return -1;
        if (ROWS(factor) != n || COLUMNS(factor) != n)
            bad = wrong("every factor must be (n, n) with n = D / blocks");
        else
            remove_row(n, DATA(factor), index, cs + g * 2 * n);
        PyBuffer_Release(&factor);
        if (bad)
            return -1;
    }
    return 0;
}

static int remove_checked(Py_buffer *state, Py_buffer *other, PyObject *factors, PyObject *blocks, Py_ssize_t index)
{
    const Py_ssize_t D = COLUMNS(*state), many = PySequence_Size(factors), count = PySequence_Size(blocks);
    if (many < 0 || count < 0)
        return -1;
    const Py_ssize_t n = count ? D / count : 0;
    if (!n || !many || n * count != D || ROWS(*state) != D + 1 || ROWS(*other) != D + 1 || COLUMNS(*other) != D)
        return wrong("state (D + 1, D), other (D + 1, D), factors and blocks do not fit");
    if (index < 0 || index >= n)
        return wrong("there is no such basis vector");
    double *cs = PyMem_Malloc(2 * n * many * sizeof(double));
    Py_ssize_t *groups = PyMem_Malloc(count * sizeof(Py_ssize_t));
    int bad = -1;
    if (!cs || !groups)
        PyErr_NoMemory();
    else
        bad = read_groups(blocks, count, many, groups) || remove_rows(factors, many, n, index, cs) ? -1 : 0;
    if (!bad)
        marginalise(D, n, DATA(*state), DATA(*other), groups, index, cs);
    PyMem_Free(cs);
    PyMem_Free(groups);
    return bad;
}

static PyObject *remove_vector(PyObject *self, PyObject *args)
{
    PyObject *first, *second, *factors, *blocks;
    Py_ssize_t index;
    Py_buffer state, other;
    if (!PyArg_ParseTuple(args, "OOOOn", &first, &second, &factors, &blocks, &index) ||
        take(first, &state, "state", 2, 1))
        return NULL;
    if (take(second, &other, "other", 2, 1)) {
        PyBuffer_Release(&state);
        return NULL;
    }
    int bad = remove_checked(&state, &other, factors, blocks, index);
    PyBuffer_Release(&state);
    PyBuffer_Release(&other);
    if (bad)
        return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"whiten", whiten, METH_VARARGS, "whiten(factor, k): k <- L^-1 k, in place."},
    {"condition", condition, METH_VARARGS, "condition(state, p, innovation, variance), in place; p is used up."},
    {"remove", remove_vector, METH_VARARGS, "remove(state, other, factors, blocks, index); state is used up."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_compiled", "See plain.py.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__compiled(void)
{
    return PyModule_Create(&module);
}
