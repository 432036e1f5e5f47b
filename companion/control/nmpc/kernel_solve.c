/* The interior-point method on the stages of kernel_stage.c, which is compiled before this. */

typedef long long Mask __attribute__((vector_size(8 * WIDTH)));

static inline Lanes larger(Lanes a, Lanes b) {
    Mask mask = a > b;
    return (Lanes)((mask & (Mask)a) | (~mask & (Mask)b));
}

static inline double sum(Lanes v) {
    double all = v[0];
    for (int n = 1; n < WIDTH; n++) all += v[n];
    return all;
}

static int cholesky(double S[NU][NU]) {
    for (int j = 0; j < NU; j++) {
        for (int k = 0; k < j; k++)
            for (int i = j; i < NU; i++) S[i][j] -= S[i][k] * S[j][k];
        if (!(S[j][j] > 0.0)) return 0;
        S[j][j] = 1.0 / sqrt(S[j][j]);
        for (int i = j + 1; i < NU; i++) S[i][j] *= S[j][j];
    }
    return 1;
}

/* Find the gains of all stages by the Riccati recursion; return 0 where a factor is singular. */
static int factorise(Stage *stages, int N, double dt, double quadratic) {
    double P[PZ][PZ], T[PZ][DENSE], M[DENSE][DENSE], K[NU][PZ];
    const Lanes none = {0};
    memset(P, 0, sizeof P);
    memset(T, 0, sizeof T);
    for (int i = N - 1; i >= 0; i--) {
        Stage *g = stages + i;
        add_hessian(g, quadratic, P);
        Lanes Pb[PZ / WIDTH] = {{0}};
        for (int k = 0; k < PX; k++) /* P is symmetric: its rows are its columns */
            if (!EMPTY(k)) add(Pb, g->gap[k], P[k], PZ);
        put(g->Pb, Pb, PZ);
        for (int r = 0; r < PZ; r++) { /* T = P [F; 0 I], without the double integrator's columns */
            if (EMPTY(r)) continue;
            Lanes row[DENSE / WIDTH] = {{0}};
            for (int v = 0; v < NU / WIDTH; v++) row[NU / WIDTH + v] = AT(P[r] + PX, v);
            for (int k = 0; k < PX; k++)
                if (!EMPTY(k)) add(row, P[r][k], g->F[k], DENSE);
            put(T[r], row, DENSE);
        }
        for (int r = 0; r < DENSE; r++) { /* M = [F; 0 I]' T, rows of attitude and w */
            Lanes row[DENSE / WIDTH] = {{0}};
            if (r >= 4) add(row, 1.0, T[PX + r - 4], DENSE);
            for (int k = 0; k < PX; k++)
                if (!EMPTY(k)) add(row, g->F[k][r], T[k], DENSE);
            put(M[r], row, DENSE);
        }
        for (int r = 0; r < 3; r++) { /* M, rows of position and velocity, in place of P and T */
            double *p = P[r], *v = P[4 + r];
            add(&AT(v, 0), dt, p, 8);
            add(&AT(p + 4, 0), dt, p, 4);
            add(&AT(v + 4, 0), dt, v, 4);
            add(&AT(T[4 + r], 0), dt, T[r], DENSE);
        }
        for (int r = 0; r < NU; r++) {
            for (int c = 0; c < NU; c++) g->L[r][c] = M[4 + r][4 + c];
            g->L[r][r] += g->R[r];
            for (int c = 0; c < 4; c++) {
                g->Y[r][c] = T[c][4 + r];
                g->Y[r][4 + c] = T[4 + c][4 + r];
                g->Y[r][8 + c] = M[4 + r][c];
                g->Y[r][12 + c] = c == r ? -g->R[r] : 0.0;
            }
        }
        if (!cholesky(g->L)) return 0;
        for (int v = 0; v < PZ / WIDTH; v++) {
            Lanes y[NU];
            for (int r = 0; r < NU; r++) {
                y[r] = AT(g->Y[r], v);
                for (int k = 0; k < r; k++) y[r] -= g->L[r][k] * y[k];
                AT(g->Y[r], v) = y[r] *= g->L[r][r];
            }
            for (int r = NU - 1; r >= 0; r--) {
                for (int k = r + 1; k < NU; k++) y[r] -= g->L[k][r] * y[k];
                AT(K[r], v) = y[r] *= g->L[r][r];
            }
        }
        for (int c = 0; c < PZ; c++)
            for (int r = 0; r < NU; r++) g->Kt[c][r] = K[r][c];
        for (int r = 0; r < 4; r++) { /* the rest of M, into P */
            for (int c = 0; c < 4; c++) P[8 + r][c] = T[c][r], P[8 + r][4 + c] = T[4 + c][r];
            for (int v = 0; v < 4 / WIDTH; v++) {
                if (r < 3) AT(P[r] + 8, v) = AT(T[r], v), AT(P[4 + r] + 8, v) = AT(T[4 + r], v);
                AT(P[8 + r] + 8, v) = AT(M[r], v);
                for (int block = 0; block < 3; block++) AT(P[4 * block + r] + 12, v) = none;
            }
            for (int v = 0; v < PZ / WIDTH; v++) AT(P[12 + r], v) = none;
            P[12 + r][12 + r] = g->R[r];
        }
        for (int r = 0; r < PZ; r++) {
            if (EMPTY(r)) continue;
            Lanes row[PZ / WIDTH];
            for (int v = 0; v < PZ / WIDTH; v++) row[v] = AT(P[r], v);
            for (int k = 0; k < NU; k++) add(row, -g->Y[k][r], g->Y[k], PZ);
            put(P[r], row, PZ);
        }
    }
    return 1;
}

/* Find the next point for the present pushes. */
static void solve_point(Stage *stages, int N, double dt, double penalty) {
    double p[PZ] = {0}, k[MAX_STAGES][NU];
    for (int i = N - 1; i >= 0; i--) {
        Stage *g = stages + i;
        add_gradient(g, penalty, p);
        double y[PZ], m[DENSE], low[NU];
        for (int v = 0; v < PZ / WIDTH; v++) AT(y, v) = AT(p, v) + AT(g->Pb, v);
        Lanes dense[DENSE / WIDTH] = {{0}};
        for (int v = 0; v < NU / WIDTH; v++) dense[NU / WIDTH + v] = AT(y + PX, v) + AT(g->r, v);
        for (int n = 0; n < PX; n++)
            if (!EMPTY(n)) add(dense, y[n], g->F[n], DENSE);
        put(m, dense, DENSE);
        for (int n = 0; n < NU; n++) {
            low[n] = m[4 + n];
            for (int c = 0; c < n; c++) low[n] -= g->L[n][c] * low[c];
            low[n] *= g->L[n][n];
        }
        for (int n = NU - 1; n >= 0; n--) {
            k[i][n] = low[n];
            for (int c = n + 1; c < NU; c++) k[i][n] -= g->L[c][n] * k[i][c];
            k[i][n] *= g->L[n][n];
        }
        Lanes next[PZ / WIDTH];
        for (int v = 0; v < 8 / WIDTH; v++) next[v] = AT(y, v);
        add(next + 4 / WIDTH, dt, y, 4);
        for (int v = 0; v < 4 / WIDTH; v++) {
            next[8 / WIDTH + v] = dense[v];
            next[12 / WIDTH + v] = -AT(g->r, v);
        }
        for (int n = 0; n < NU; n++) add(next, -low[n], g->Y[n], PZ);
        put(p, next, PZ);
    }
    double z[PZ] = {0};
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        Lanes w[NU / WIDTH], more[NU / WIDTH] = {{0}}, x[PX / WIDTH];
        for (int v = 0; v < NU / WIDTH; v++) w[v] = -AT(k[i], v);
        for (int c = 0; c < PZ; c += 2) {
            add(w, -z[c], g->Kt[c], NU);
            if (!EMPTY(c + 1)) add(more, -z[c + 1], g->Kt[c + 1], NU);
        }
        for (int v = 0; v < NU / WIDTH; v++) AT(g->wn, v) = w[v] + more[v];
        for (int v = 0; v < PX / WIDTH; v++) x[v] = AT(g->gap, v);
        for (int v = 0; v < 8 / WIDTH; v++) x[v] += AT(z, v);
        for (int v = 0; v < 4 / WIDTH; v++) x[v] += dt * AT(z + 4, v);
        for (int c = 0; c < 4; c++) add(x, z[8 + c], g->Ft[c], PX);
        for (int c = 0; c < NU; c++) add(x, g->wn[c], g->Ft[4 + c], PX);
        put(g->xn, x, PX);
        memcpy(z, g->xn, sizeof g->xn);
        memcpy(z + PX, g->wn, sizeof g->wn);
        const double *weight = g->gamma + BOUNDS;
        for (int n = 0; n < g->rows / WIDTH; n++) {
            Lanes nearer = AT(g->along[0], n) * z[0] + AT(g->along[1], n) * z[1] +
                           AT(g->along[2], n) * z[2];
            AT(g->sn, n) = -(AT(g->gs, n) + AT(weight, n) * nearer) * AT(g->by_Hs, n);
        }
    }
}

/* The way from the point to the next one: the longest step, up to 1, that keeps t and l > 0, and
 * the sums of t l and of its first and second derivative by the length of the step. */
typedef struct {
    double longest, zeroth, first, second;
} Way;

/* Find the steps of t and l to the next point. */
static Way steps(Stage *stages, int N) {
    static const double none[NU] = {0};
    double next[MAX_CONSTRAINTS];
    Lanes zeroth = {0}, first = {0}, second = {0}, worst = 1.0 + zeroth;
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        values(g, g->xn, g->wn, g->sn, i ? stages[i - 1].wn : none, next);
        for (int c = 0; c < g->constraints / WIDTH; c++) {
            Lanes t = AT(g->t, c), l = AT(g->l, c), real = AT(g->real, c);
            Lanes dt = real * (AT(next, c) + AT(g->a, c) - t);
            Lanes dl = real * (AT(g->push, c) - AT(g->gamma, c) * AT(next, c) - l);
            AT(g->dt, c) = dt;
            AT(g->dl, c) = dl;
            worst = larger(larger(worst, -dt * AT(g->inverse, c)), -dl / l);
            zeroth += real * t * l;
            first += t * dl + l * dt;
            second += dt * dl;
        }
    }
    double most = 1.0;
    for (int n = 0; n < WIDTH; n++) most = fmax(most, worst[n]);
    return (Way){1.0 / most, sum(zeroth), sum(first), sum(second)};
}

/* Return how far the constraint that is broken most is broken by no step and no slack. */
static double broken(const Stage *stages, int N) {
    double most = 0.0;
    for (int i = 0; i < N; i++)
        for (int c = 0; c < stages[i].constraints; c++) most = fmax(most, -stages[i].a[c]);
    return most;
}

/* Return the multiplier that constraint c of a stage had at the last solution; or where it is. */
static double *kept(Stage *g, int c) {
    if (c < BOUNDS) return g->kept + c;
    int n = c - BOUNDS;
    return g->kept + BOUNDS + (n < g->rows ? g->row[n] : MAX_ROWS + g->row[n - g->rows]);
}

/* Keep the multipliers and slacks of a solution. */
static void keep(Stage *stages, int N, int rows) {
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        memset(g->deep, 0, rows * sizeof g->deep[0]);
        memset(g->kept + BOUNDS, 0, rows * sizeof g->kept[0]);
        memset(g->kept + BOUNDS + MAX_ROWS, 0, rows * sizeof g->kept[0]);
        for (int c = 0; c < g->constraints; c++)
            if (g->real[c]) *kept(g, c) = g->l[c];
        for (int n = 0; n < g->rows; n++)
            if (g->real[BOUNDS + n]) g->deep[g->row[n]] = g->s[n];
    }
}

/* Set the first point, which makes no step; return the number of constraints. */
static double begin(const Program *p, Stage *stages) {
    static const double none[NU] = {0};
    double room = LEAST_ROOM, total = 0.0;
    if (!p->again) room = fmin(fmax(room, broken(stages, p->N)), MOST_ROOM);
    for (int i = 0; i < p->N; i++) {
        Stage *g = stages + i;
        memset(g->x, 0, sizeof g->x);
        memset(g->w, 0, sizeof g->w);
        for (int n = 0; n < g->rows; n++) {
            double first = fmax(0.0, -g->a[BOUNDS + n]) + room;
            if (p->again && g->real[BOUNDS + n]) first = fmax(g->deep[g->row[n]], LEAST_SLACK);
            g->s[n] = g->real[BOUNDS + n] * first;
        }
        values(g, g->x, g->w, g->s, none, g->t);
        for (int c = 0; c < g->constraints; c++) {
            double before = p->again && g->real[c] ? *kept(g, c) : 0.0;
            g->t[c] = g->real[c] ? fmax(g->t[c] + g->a[c], room) : 1.0;
            g->l[c] = g->real[c] ? fmax(p->complementarity / g->t[c], before) : NOTHING;
            total += g->real[c];
        }
    }
    return total;
}

/* Set gamma and the pushes without target; return the sum of t l. */
static double weigh(Stage *stages, int N) {
    Lanes all = {0};
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        for (int c = 0; c < g->constraints / WIDTH; c++) {
            Lanes t = AT(g->t, c), l = AT(g->l, c), inverse = 1.0 / t;
            AT(g->inverse, c) = inverse;
            AT(g->gamma, c) = l * inverse;
            AT(g->push, c) = l - l * inverse * AT(g->a, c);
            all += AT(g->real, c) * t * l;
        }
    }
    return sum(all);
}

/* Find the steps dx, du of the quadratic program; return the iterations taken, or -1. */
int solve_program(const Program *given) {
    const Program program = *given, *p = &program;
    Stage *stages = p->work;
    if (p->rows > MAX_ROWS || p->N > MAX_STAGES) return -1;
    load(p, stages);
    double total = begin(p, stages), infeasible = 1.0;
    for (int iteration = 1; iteration <= MAX_ITERATIONS; iteration++) {
        double mu = weigh(stages, p->N) / total;
        int last = iteration == MAX_ITERATIONS; /* good enough for an SQP step, then */
        double enough = last ? 100.0 * p->tolerance : p->tolerance;
        if (mu < enough && infeasible < enough) {
            for (int i = 0; i < p->N; i++) {
                for (int n = 0; n < NX; n++) p->dx[i * NX + n] = stages[i].x[PLACE(n)];
                memcpy(p->du + i * NU, stages[i].w, sizeof stages[i].w);
            }
            keep(stages, p->N, p->rows);
            return iteration - 1;
        }
        if (!factorise(stages, p->N, p->dt, p->quadratic)) return -1;
        solve_point(stages, p->N, p->dt, p->penalty);
        Way way = steps(stages, p->N);
        double length = way.longest;
        double ahead = (way.zeroth + length * (way.first + length * way.second)) / total;
        double sigma = ahead / mu;
        sigma = sigma * sigma * sigma;
        double target = sigma * mu;
        /* The second-order term holds at the end of the predictor's step. Where that step was
         * short, taking all of it makes the iteration cycle; its square is Colombo and
         * Gondzio's least weight. */
        double weight = length * length;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int c = 0; c < g->constraints / WIDTH; c++)
                AT(g->push, c) += AT(g->real, c) * AT(g->inverse, c) *
                                  (target - weight * AT(g->dt, c) * AT(g->dl, c));
        }
        solve_point(stages, p->N, p->dt, p->penalty);
        length = steps(stages, p->N).longest;
        if (length < 1.0) length *= 1.0 - fmin(5e-3, mu);
        if (!(length > 1e-10)) return -1;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int v = 0; v < PX / WIDTH; v++)
                AT(g->x, v) += length * (AT(g->xn, v) - AT(g->x, v));
            for (int v = 0; v < NU / WIDTH; v++)
                AT(g->w, v) += length * (AT(g->wn, v) - AT(g->w, v));
            for (int n = 0; n < g->rows / WIDTH; n++)
                AT(g->s, n) += length * (AT(g->sn, n) - AT(g->s, n));
            for (int c = 0; c < g->constraints / WIDTH; c++) {
                AT(g->t, c) += length * AT(g->dt, c);
                AT(g->l, c) += length * AT(g->dl, c);
            }
        }
        infeasible *= 1.0 - length;
    }
    return -1;
}
