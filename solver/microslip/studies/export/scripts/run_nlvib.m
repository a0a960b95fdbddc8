% Frequency response of model.mat by NLvib.
%
%     octave-cli run_nlvib.m SRC [MODEL_FOLDER]      or, in MATLAB: SRC = '...'; run_nlvib
%
% SRC is the folder SRC of NLvib 1.3 (github.com/maltekrack/NLvib).  Each tangential direction of a pair becomes an
% elasticDryFriction element of the constant limit mu N0, each normal direction a unilateralSpring; nlvib_residual.m, beside this
% file, is what fsolve calls.  Writes response_nlvib.csv.

arguments = {};
if exist('OCTAVE_VERSION', 'builtin'), arguments = argv(); end
if ~isempty(arguments), SRC = arguments{1}; end
folder = fileparts(mfilename('fullpath'));
if numel(arguments) > 1, folder = arguments{2}; end
if isempty(folder), folder = '.'; end
addpath(SRC); addpath(fileparts(mfilename('fullpath')));
model = load(fullfile(folder, 'model.mat'));

if any(~strcmp(model.law, 'elastic-coulomb')), error('pairs of a law that NLvib does not have'); end
if ~isempty(model.S), error('structural damping: NLvib has none'); end
if any(model.T0(:)), error('friction forces at rest (T0): the elements start without any'); end

% q = D x, with x of one size
n = size(model.M, 1); H = model.harmonics; N = model.samples; n_pairs = numel(model.mu);
K_L = model.K + model.R' * diag(model.K_J) * model.R;
D = diag(1 ./ sqrt(diag(K_L)));
if n == 1, D = 1; end % NLvib takes the one coordinate itself for that of an element
scaled = @(A) D * A * D;
R = model.R * D;

% elements, and what they carry at rest
elements = {}; rest = zeros(n, 1);
for i = 1:n_pairs
    limits = [model.mu(i), model.mu_y(i)] * max(model.N0(i), 0);
    stiffness = [model.k_t(i), model.k_ty(i)];
    for axis = 1:2
        w = R(3 * (i - 1) + axis, :)';
        if any(w)
            elements{end+1} = struct('type', 'elasticDryFriction', 'stiffness', stiffness(axis), ...
                'friction_limit_force', limits(axis), 'ishysteretic', true, 'islocal', true, 'force_direction', w);
        end
    end
    w = -R(3 * i, :)'; % the spring pushes when it is compressed
    if any(w)
        elements{end+1} = struct('type', 'unilateralSpring', 'stiffness', model.k_n(i), ...
            'gap', -model.N0(i) / model.k_n(i), 'ishysteretic', false, 'islocal', true, 'force_direction', w);
        rest = rest + w * max(model.N0(i), 0);
    end
end
system_ = struct('M', scaled(model.M), 'D', scaled(model.C), 'K', scaled(model.K), 'Fex1', zeros(n, 1));
system_.nonlinear_elements = elements;

shown = find(~(any(model.output_p, 2) | any(model.output_base, 2)));
parts = {'mean'};
for k = 1:H, parts{end+1} = sprintf('cos %d', k); parts{end+1} = sprintf('sin %d', k); end
file = fopen(fullfile(folder, 'response_nlvib.csv'), 'w');
fprintf(file, 'level_N,frequency_Hz,seconds');
for o = shown', for k = 1:numel(parts), fprintf(file, ',%s %s', model.output_name{o}, parts{k}); end, end
fprintf(file, '\n');

options = optimset('Jacobian', 'on', 'TolFun', 1e-12, 'TolX', 1e-12, 'MaxIter', 200, 'Display', 'off');
total = 0; count = 0;
for level = model.levels'
    F = level * D * model.load;
    system_.Fex1 = F(:, 2) - 1i * F(:, 3);
    others = F; others(:, 2:3) = 0; others(:, 1) = others(:, 1) + rest; % NLvib itself loads harmonic 1 alone
    Om = 2 * pi * model.frequency(1);
    Q = (scaled(K_L) - Om^2 * system_.M + 1i * Om * system_.D) \ system_.Fex1;
    x = zeros(n * (2 * H + 1), 1);
    x(n + (1:2 * n)) = [real(Q); -imag(Q)];
    before = Om;
    for frequency = model.frequency'
        Om = 2 * pi * frequency;
        began = tic;
        for n_steps = [1, 4, 16, 64] % from the last point, in one step or in as many as it takes
            y = x;
            for w = before + (Om - before) * (1:n_steps) / n_steps
                [y, r] = fsolve(@(X) nlvib_residual(X, w, system_, H, N, others(:)), y, options);
            end
            if norm(r) <= 1e-8 * norm(F(:)), break; end
        end
        x = y;
        seconds = toc(began); total = total + seconds; count = count + 1;
        if ~(norm(r) <= 1e-8 * norm(F(:))), error('no solution at %g N, %g Hz', level, frequency); end
        before = Om;
        q = D * reshape(x, n, []);
        fprintf(file, '%.17g,%.17g,%.6g', level, frequency, seconds);
        for o = shown'
            y = model.outputs(o, :) * q;
            for k = 1:H
                amplitude = (y(2 * k) - 1i * y(2 * k + 1)) * (1i * k * Om) ^ model.output_order(o);
                y(2 * k) = real(amplitude); y(2 * k + 1) = -imag(amplitude);
            end
            if model.output_order(o) > 0, y(1) = 0; end
            fprintf(file, ',%.17g', y);
        end
        fprintf(file, '\n');
    end
end
fclose(file);
fprintf('%s: %d points in %.3g s\n', fullfile(folder, 'response_nlvib.csv'), count, total);
