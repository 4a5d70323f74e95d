/* What plain.py does with numpy and scipy, without the cost of their calls: what every reading pays for.
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

/* Four sums at a time, so that they need not wait for one another. */
FAST static double dot(Py_ssize_t n, const double *restrict x, const double *restrict y)
{
    double sums[4] = {0, 0, 0, 0};
    Py_ssize_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int k = 0; k < 4; k++)
            sums[k] += x[i + k] * y[i + k];
    for (; i < n; i++)
        sums[0] += x[i] * y[i];
    return (sums[0] + sums[2]) + (sums[1] + sums[3]);
}

/* x <- L^-T x */
static void solve_transposed(Py_ssize_t n, const double *L, double *x)
{
    for (Py_ssize_t j = n - 1; j >= 0; j--)
        x[j] = (x[j] - dot(n - 1 - j, L + j + 1 + j * n, x + j + 1)) / L[j + j * n];
}

/* out <- out + variance g(s), s the squared scaled distances of the m columns of `rows` (d, m) from `here` (d,) */
FAST static void add_covariance(int kind, Py_ssize_t m, Py_ssize_t d, const double *rows, const double *here,
                                double variance, double *squared, double *restrict out)
{
    double *restrict s = squared;
    memset(s, 0, m * sizeof(double));
    for (Py_ssize_t i = 0; i < d; i++) {
        const double *restrict row = rows + i * m;
        const double origin = here[i];
        for (Py_ssize_t j = 0; j < m; j++)
            s[j] += (row[j] - origin) * (row[j] - origin);
    }
    if (kind == 0) /* squared exponential */
        for (Py_ssize_t j = 0; j < m; j++)
            out[j] += variance * exp(-0.5 * s[j]);
    else /* Matern 3/2 */
        for (Py_ssize_t j = 0; j < m; j++) {
            const double u = sqrt(3.0 * s[j]);
            out[j] += variance * (1.0 + u) * exp(-u);
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

/* Rows that a sequence of rotations takes in one go. */
#define STRIP 16

/* For columns j = from ... to - 1 of `count` rows of M, one after the other: (M_j, M_j+1) <- (c M_j + s M_j+1,
 * c M_j+1 - s M_j) with the cosines and sines in cs. `carry` (count) is column `from` at the start, column `to` at the
 * end; the columns before that are written. */
static inline void turn(Py_ssize_t count, Py_ssize_t stride, Py_ssize_t from, Py_ssize_t to, const double *cs,
                        double *M, double *restrict carry)
{
    for (Py_ssize_t j = from; j < to; j++) {
        const double c = cs[2 * j], s = cs[2 * j + 1];
        double *restrict out = M + j * stride;
        const double *restrict in = M + (j + 1) * stride;
        for (Py_ssize_t k = 0; k < count; k++) {
            const double next = in[k];
            out[k] = c * carry[k] + s * next;
            carry[k] = c * next - s * carry[k];
        }
    }
}

/* The same for STRIP rows, what is carried in registers: left to itself the compiler keeps it in memory. */
typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));

static inline void turn_strip(Py_ssize_t stride, Py_ssize_t from, Py_ssize_t to, const double *cs, double *M,
                              double *carry)
{
    Four w = *(Four *)carry, x = *(Four *)(carry + 4), y = *(Four *)(carry + 8), z = *(Four *)(carry + 12);
    for (Py_ssize_t j = from; j < to; j++) {
        const double c = cs[2 * j], s = cs[2 * j + 1];
        Four *out = (Four *)(M + j * stride), *in = (Four *)(M + (j + 1) * stride);
        const Four next_w = in[0], next_x = in[1], next_y = in[2], next_z = in[3];
        out[0] = c * w + s * next_w, w = c * next_w - s * w;
        out[1] = c * x + s * next_x, x = c * next_x - s * x;
        out[2] = c * y + s * next_y, y = c * next_y - s * y;
        out[3] = c * z + s * next_z, z = c * next_z - s * z;
    }
    *(Four *)carry = w, *(Four *)(carry + 4) = x, *(Four *)(carry + 8) = y, *(Four *)(carry + 12) = z;
}

/* The same for all rows of M (rows, columns), of which column `to` is written as well. */
FAST static void turn_all(Py_ssize_t rows, Py_ssize_t stride, Py_ssize_t from, Py_ssize_t to, const double *cs,
                          double *M)
{
    double carry[STRIP];
    Py_ssize_t row = 0;
    for (; row + STRIP <= rows; row += STRIP) {
        memcpy(carry, M + row + from * stride, sizeof carry);
        turn_strip(stride, from, to, cs, M + row, carry);
        memcpy(M + row + to * stride, carry, sizeof carry);
    }
    memcpy(carry, M + row + from * stride, (rows - row) * sizeof(double));
    turn(rows - row, stride, from, to, cs, M + row, carry);
    memcpy(M + row + to * stride, carry, (rows - row) * sizeof(double));
}

/* Make L (n, n) without its row `index` lower triangular again by rotating columns j and j + 1, whose cosines and sines
 * are written to cs. The rows behind move up; the last row and column become those of the spare coordinate. */
FAST static void remove_row(Py_ssize_t n, double *L, Py_ssize_t index, double *cs)
{
    double carry[STRIP];
    for (Py_ssize_t top = index + 1; top < n; top += STRIP) {
        const Py_ssize_t count = n - top < STRIP ? n - top : STRIP;
        memcpy(carry, L + top + index * n, count * sizeof(double));
        if (count == STRIP)
            turn_strip(n, index, top - 1, cs, L + top, carry);
        else
            turn(count, n, index, top - 1, cs, L + top, carry);
        for (Py_ssize_t k = 0; k < count; k++) { /* each row of the strip decides the next rotation */
            const Py_ssize_t j = top + k - 1;
            const double diagonal = L[top + k + (j + 1) * n], radius = hypot(carry[k], diagonal);
            cs[2 * j] = carry[k] / radius, cs[2 * j + 1] = diagonal / radius;
            turn(count - k, n, j, j + 1, cs, L + top + k, carry + k);
        }
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

static int take_in(int order, PyObject *object, Py_buffer *view, const char *name, int dimensions, int writable)
{
    if (PyObject_GetBuffer(object, view, order | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)))
        return -1;
    if (view->ndim == dimensions && view->itemsize == sizeof(double) && strcmp(view->format, "d") == 0)
        return 0;
    PyBuffer_Release(view);
    PyErr_Format(PyExc_ValueError, "%s must be a float64 array of %d dimensions", name, dimensions);
    return -1;
}

/* A buffer of float64 in column order with so many dimensions; 0 on success. */
static int take(PyObject *object, Py_buffer *view, const char *name, int dimensions, int writable)
{
    return take_in(PyBUF_F_CONTIGUOUS, object, view, name, dimensions, writable);
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

static PyObject *triangular(PyObject *args, void (*in_place)(Py_ssize_t, const double *, double *))
{
    PyObject *first, *second;
    Py_buffer L, x;
    if (!PyArg_ParseTuple(args, "OO", &first, &second) || take(first, &L, "factor", 2, 0))
        return NULL;
    if (take(second, &x, "the vector", 1, 1)) {
        PyBuffer_Release(&L);
        return NULL;
    }
    int bad = ROWS(L) != COLUMNS(L) || ROWS(L) != ROWS(x) ? wrong("factor (n, n) and vector (n,) do not fit") : 0;
    if (!bad)
        in_place(ROWS(x), DATA(L), DATA(x));
    PyBuffer_Release(&L);
    PyBuffer_Release(&x);
    if (bad)
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *whiten(PyObject *self, PyObject *args)
{
    return triangular(args, solve);
}

static PyObject *unwhiten(PyObject *self, PyObject *args)
{
    return triangular(args, solve_transposed);
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

/* diag (L L^T)^-1 without basis vector `index`, whose column of it is c: minus c^2 / c_index, but not below `least`. */
static void drop_precision(Py_ssize_t n, const double *L, double *precision, Py_ssize_t index, double least, double *c)
{
    memset(c, 0, n * sizeof(double));
    c[index] = 1.0;
    solve(n, L, c);
    solve_transposed(n, L, c);
    const double share = 1.0 / c[index];
    for (Py_ssize_t i = 0; i < n; i++) {
        const double left = precision[i] - c[i] * c[i] * share;
        precision[i] = left > least ? left : least;
    }
    memmove(precision + index, precision + index + 1, (n - 1 - index) * sizeof(double));
    precision[n - 1] = 0.0;
}

static PyObject *drop_precision_checked(PyObject *self, PyObject *args)
{
    PyObject *first, *second;
    Py_ssize_t index;
    double least;
    Py_buffer L, precision;
    if (!PyArg_ParseTuple(args, "OOnd", &first, &second, &index, &least) || take(first, &L, "factor", 2, 0))
        return NULL;
    if (take(second, &precision, "precision", 1, 1)) {
        PyBuffer_Release(&L);
        return NULL;
    }
    const Py_ssize_t n = ROWS(L);
    int bad = COLUMNS(L) != n || ROWS(precision) != n || index < 0 || index >= n
                  ? wrong("factor (n, n), precision (n,) and index do not fit")
                  : 0;
    double *column = bad ? NULL : PyMem_Malloc(n * sizeof(double));
    if (!bad && !column) {
        PyErr_NoMemory();
        bad = -1;
    }
    if (!bad)
        drop_precision(n, DATA(L), DATA(precision), index, least, column);
    PyMem_Free(column);
    PyBuffer_Release(&L);
    PyBuffer_Release(&precision);
    if (bad)
        return NULL;
    Py_RETURN_NONE;
}

/* One component of `covariances`: row c of the recipe is (part, kind, variance); 0 on success. */
static int add_component(Py_buffer *table, Py_ssize_t row, Py_ssize_t d, const double *here, const double *recipe,
                         PyObject *parts, double *squared)
{
    const Py_ssize_t m = COLUMNS(*table);
    Py_buffer part;
    PyObject *item = PySequence_GetItem(parts, (Py_ssize_t)recipe[0]);
    int bad = !item || take(item, &part, "part", 1, 1);
    Py_XDECREF(item);
    if (bad)
        return -1;
    if (ROWS(part) < m || (recipe[1] != 0.0 && recipe[1] != 1.0))
        bad = wrong("a part is shorter than the table, or of an unknown kind");
    else
        add_covariance((int)recipe[1], m, d, DATA(*table) + row * m, here, recipe[2], squared, DATA(part));
    PyBuffer_Release(&part);
    return bad;
}

static int covariances_checked(Py_buffer *table, Py_buffer *here, Py_buffer *recipe, Py_ssize_t first, PyObject *parts)
{
    const Py_ssize_t components = COLUMNS(*recipe), rows = ROWS(*table), m = COLUMNS(*table);
    const Py_ssize_t d = components ? ROWS(*here) / components : 0;
    if (ROWS(*recipe) != 3 || d * components != ROWS(*here) || first < 0 || first + ROWS(*here) > rows)
        return wrong("table, first row, here and recipe do not fit");
    double *squared = PyMem_Malloc((m + 1) * sizeof(double));
    if (!squared) {
        PyErr_NoMemory();
        return -1;
    }
    int bad = 0;
    for (Py_ssize_t c = 0; !bad && c < components; c++)
        bad = add_component(table, first + c * d, d, DATA(*here) + c * d, DATA(*recipe) + 3 * c, parts, squared);
    PyMem_Free(squared);
    return bad;
}

static PyObject *covariances(PyObject *self, PyObject *args)
{
    PyObject *first, *second, *third, *parts;
    Py_ssize_t row;
    Py_buffer table, here, recipe;
    if (!PyArg_ParseTuple(args, "OnOOO", &first, &row, &second, &third, &parts) ||
        take_in(PyBUF_C_CONTIGUOUS, first, &table, "table", 2, 0))
        return NULL;
    int bad = take(second, &here, "here", 1, 0);
    if (!bad) {
        bad = take(third, &recipe, "recipe", 2, 0);
        if (!bad) {
            bad = covariances_checked(&table, &here, &recipe, row, parts);
            PyBuffer_Release(&recipe);
        }
        PyBuffer_Release(&here);
    }
    PyBuffer_Release(&table);
    if (bad)
        return NULL;
    Py_RETURN_NONE;
}

/* One pass of the removal: rotate the columns of every block of M (rows, D) as its group's factor asks. */
static void rotate_blocks(Py_ssize_t rows, Py_ssize_t used, double *M, Py_ssize_t n, Py_ssize_t blocks,
                          const Py_ssize_t *groups, Py_ssize_t index, const double *cs)
{
    for (Py_ssize_t b = 0; b < blocks; b++)
        turn_all(used, rows, index, n - 1, cs + groups[b] * 2 * n, M + b * n * rows);
}

/* other <- state^T, of the first D rows; in blocks, so that both are in the cache. */
static void transpose(Py_ssize_t D, Py_ssize_t rows, const double *restrict state, double *restrict other)
{
    for (Py_ssize_t i0 = 0; i0 < D; i0 += 8)
        for (Py_ssize_t j0 = 0; j0 < D; j0 += 8)
            for (Py_ssize_t i = i0; i < i0 + 8 && i < D; i++)
                for (Py_ssize_t j = j0; j < j0 + 8 && j < D; j++)
                    other[j + i * rows] = state[i + j * rows];
}

static void marginalise(Py_ssize_t D, Py_ssize_t n, double *state, double *other, const Py_ssize_t *groups,
                        Py_ssize_t index, const double *cs)
{
    const Py_ssize_t rows = D + 1, blocks = D / n;
    rotate_blocks(rows, rows, state, n, blocks, groups, index, cs);
    transpose(D, rows, state, other);
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
    {"unwhiten", unwhiten, METH_VARARGS, "unwhiten(factor, a): a <- L^-T a, in place."},
    {"covariances", covariances, METH_VARARGS, "covariances(table, first_row, here, recipe, parts): added to the parts."},
    {"drop_precision", drop_precision_checked, METH_VARARGS, "drop_precision(factor, precision, index, least): of diag (L L^T)^-1."},
    {"condition", condition, METH_VARARGS, "condition(state, p, innovation, variance), in place; p is used up."},
    {"remove", remove_vector, METH_VARARGS, "remove(state, other, factors, blocks, index); state is used up."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_compiled", "See plain.py.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__compiled(void)
{
    return PyModule_Create(&module);
}
