#!/usr/bin/perl
# Places where a mistake can be put into the program, for tests/mutate.sh.
#
#   mutants.pl list SEED FILE...        one a line: kind, file, line, column, old text, new text
#   mutants.pl apply FILE LINE COLUMN OLD NEW    changes the file
#   mutants.pl line FILE LINE           its text without indentation
#
# Comments, strings and directives are left alone. The order is that of a shuffle by SEED in which
# the kinds of change take turns, and kernels and host within each.
use strict;
use warnings;

my %kinds = (
    comparison => [
        [qr/ < /, ' <= '], [qr/ <= /, ' < '], [qr/ > /, ' >= '], [qr/ >= /, ' > '],
        [qr/ == /, ' != '], [qr/ != /, ' == '],
    ],
    logic => [[qr/ && /, ' || '], [qr/ \|\| /, ' && ']],
    sum => [[qr/ \+ /, ' - '], [qr/ - /, ' + '], [qr/ \+= /, ' -= '], [qr/ -= /, ' += ']],
    product => [[qr/ \* /, ' / '], [qr/ \/ /, ' * '], [qr/ << /, ' >> '], [qr/ >> /, ' << ']],
    least => [
        [qr/\bf?min\(/, sub { $_[0] =~ s/min/max/r }], [qr/\bf?max\(/, sub { $_[0] =~ s/max/min/r }],
    ],
    swap => [
        [qr/(?<=[(, ])[a-z][\w.>\[\]-]*, [a-z][\w.>\[\]-]*(?=[,)])/,
            sub { join ', ', reverse split /, /, $_[0] }],
    ],
    whole => [[qr/(?<![\w.\]])\d+u?(?![\w.])/, sub { my $u = $_[0] =~ s/u$// ? 'u' : ''; $_[0] + 1 . $u }]],
    real => [
        [qr/(?<![\w.])\d+\.\d*f?(?![\w.])/,
            sub {
                my $f = $_[0] =~ s/f$// ? 'f' : '';
                my $more = $_[0] == 0 ? 0.25 : $_[0] * 1.25;
                return $more . ($more =~ /\./ ? '' : '.0') . $f;
            }],
    ],
    condition => [[qr/\bif \((?=.*\)( \{)?$)/, 'if (0 && (', ')']],
    statement => [
        [qr/(?<=^)\s+(?!return|break|continue|goto|else|case|typedef|const |enum )[a-zA-Z_][\w.\[\]>-]*( [-+*\/|&^]?= .*|\(.*\));$/, ';'],
    ],
);

# The file's lines with blanks for what must not change.
sub code_of {
    my ($file) = @_;
    open my $in, '<', $file or die "$file: $!\n";
    local $/;
    my $text = <$in>;
    my $blank = sub { $_[0] =~ s/[^\n]/ /gr };
    $text =~ s{(/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')}
              {my $m = $1; $m =~ /^"/ ? '"' . '_' x (length($m) - 2) . '"' : $blank->($m)}gse;
    $text =~ s{^[ \t]*#(?:[^\n]*\\\n)*[^\n]*}{$blank->($&)}gme;
    return split /\n/, $text, -1;
}

sub lines_of {
    my ($file) = @_;
    open my $in, '<', $file or die "$file: $!\n";
    my @lines = <$in>;
    chomp @lines;
    return @lines;
}

sub list {
    my ($seed, @files) = @_;
    my %found;
    for my $file (@files) {
        my @code = code_of($file);
        my @real = lines_of($file);
        my $side = $file =~ /^kernels/ ? 'kernels' : 'host';
        for my $i (0 .. $#code) {
            for my $kind (sort keys %kinds) {
                for my $change (@{$kinds{$kind}}) {
                    my ($from, $to) = @$change;
                    pos($code[$i]) = 0; # a statement's search ends half way
                    while ($code[$i] =~ /$from/g) {
                        my ($at, $length) = ($-[0], $+[0] - $-[0]);
                        my $old = substr $real[$i], $at, $length;
                        my $copy = $old;
                        my $new = ref $to ? $to->($copy) : $to;
                        if ($kind eq 'condition') {
                            my $rest = substr $real[$i], $at + $length;
                            next if $rest =~ /"/ && $rest !~ /\)( \{)?$/;
                            $rest =~ s/\)( \{)?$/'))' . ($1 \/\/ '')/e;
                            ($old, $new) = (substr($real[$i], $at), "$to$rest");
                        }
                        push @{$found{$kind}{$side}},
                            join "\t", $kind, $file, $i + 1, $at, $old, $new;
                        pos($code[$i]) = $at + 1 if $kind ne 'statement';
                        last if $kind eq 'statement';
                    }
                }
            }
        }
    }
    srand $seed;
    my @rows;
    for my $kind (sort keys %found) {
        for my $side (sort keys %{$found{$kind}}) {
            my @these = sort @{$found{$kind}{$side}};
            for my $i (reverse 1 .. $#these) {
                my $j = int rand($i + 1);
                @these[$i, $j] = @these[$j, $i];
            }
            push @rows, \@these;
        }
    }
    while (grep { @$_ } @rows) {
        for (@rows) {
            print shift(@$_), "\n" if @$_;
        }
    }
}

my $do = shift // '';
if ($do eq 'list') {
    list(@ARGV);
} elsif ($do eq 'apply') {
    my ($file, $line, $column, $old, $new) = @ARGV;
    my @lines = lines_of($file);
    substr($lines[$line - 1], $column, length $old) eq $old
        or die "$file:$line: no '$old' at column $column\n";
    substr($lines[$line - 1], $column, length $old) = $new;
    open my $out, '>', $file or die "$file: $!\n";
    print $out "$_\n" for @lines;
    close $out or die "$file: $!\n";
} elsif ($do eq 'line') {
    my ($file, $line) = @ARGV;
    print +(lines_of($file))[$line - 1] =~ s/^\s+//r, "\n";
} else {
    die "usage: mutants.pl list|apply|line ...\n";
}
